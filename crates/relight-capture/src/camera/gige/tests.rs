//! Against Aravis' fake camera, which is its own implementation of the protocol.

use std::process::{Child, Command, Stdio};
use std::thread::sleep;

use super::*;
use crate::camera::Development;

/// The fake camera, until it is dropped. One test runs at a time: the port is fixed by the standard.
struct Fake(Child);

impl Fake {
    fn start() -> Fake {
        let program = std::env::var("RELIGHT_FAKE_CAMERA").unwrap_or("arv-fake-gv-camera-0.8".to_owned());
        let child = Command::new(program)
            .args(["-i", "127.0.0.1", "-s", "RELIGHT-7"])
            .stdout(Stdio::null())
            .spawn()
            .expect("Debian's package aravis-tools");
        sleep(Duration::from_secs(1));
        Fake(child)
    }
}

impl Drop for Fake {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn settings() -> GigeSettings {
    GigeSettings {
        address: Some(Ipv4Addr::LOCALHOST),
        serial: None,
        size: [512, 512],
        exposure_microseconds: 5000.0,
        gain: Some(0.0),
        pattern: BayerPattern::Rggb,
        patience_seconds: 2.0,
        packet_size: Some(1500),
        packet_delay_microseconds: None,
    }
}

fn raw(frame: Frame) -> Vec<u8> {
    match frame {
        Frame::Raw { data, .. } => data,
        Frame::Developed(_) => panic!("a raw frame"),
    }
}

/// By address and by serial number, every pattern, with other exposures; then without the camera.
#[test]
#[ignore = "needs arv-fake-gv-camera-0.8 of Debian's aravis-tools"]
fn a_fake_camera_shoots_and_its_loss_is_told() {
    let fake = Fake::start();
    for pattern in [BayerPattern::Bggr, BayerPattern::Grbg, BayerPattern::Gbrg, BayerPattern::Rggb] {
        let mut camera = GigeCamera::open(&GigeSettings { pattern, ..settings() }).unwrap();
        let frame = camera.shoot().unwrap();
        let (width, height) = camera.size();
        assert!(matches!(&frame, Frame::Raw { pattern: p, .. } if *p == pattern));
        let image = frame.develop(&Development::default()).unwrap();
        assert_eq!((image.width, image.height), (width, height));
        assert!(image.data.iter().any(|&byte| byte > 0));
    }
    let by_serial = GigeSettings { address: None, serial: Some("RELIGHT-7".to_owned()), ..settings() };
    let mut camera = GigeCamera::open(&by_serial).unwrap();
    // Longer exposures are brighter, until the sensor is full.
    let mean = |data: Vec<u8>| data.iter().map(|&b| f64::from(b)).sum::<f64>() / data.len() as f64;
    camera.expose(0.1).unwrap();
    let short = mean(raw(camera.shoot().unwrap()));
    camera.expose(1.0).unwrap();
    let long = mean(raw(camera.shoot().unwrap()));
    assert!(long > 2.0 * short, "{long} after {short}");
    for _ in 0..20 {
        assert_eq!(raw(camera.shoot().unwrap()).len(), (camera.size.0 * camera.size.1) as usize);
    }
    let error = GigeCamera::open(&GigeSettings { size: [640, 480], ..settings() }).err().unwrap();
    assert!(error.to_string().contains("not 640x480"), "{error}");
    let other = GigeSettings { serial: Some("NO-SUCH".to_owned()), ..by_serial };
    let error = GigeCamera::open(&other).err().unwrap().to_string();
    assert!(error.contains("NO-SUCH; found: RELIGHT-7 at 127.0.0.1"), "{error}");
    drop(fake);
    let error = camera.shoot().unwrap_err();
    assert!(matches!(error, CameraError::Failed { .. }), "{error}");
    assert!(error.to_string().contains("resume the session"), "{error}");
    drop(camera);
    let error = GigeCamera::open(&settings()).err().unwrap().to_string();
    assert!(error.contains("no camera answers at 127.0.0.1"), "{error}");
}
