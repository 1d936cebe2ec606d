//! Cameras that speak GigE Vision, on `viva-genicam`: no vendor's library is needed.

use std::net::Ipv4Addr;
use std::time::Duration;

use viva_genicam::gige::{DeviceInfo, DiscoveryOptions};
use viva_genicam::pfnc::PixelFormat;
use viva_genicam::{
    Camera as Genicam, ControlState, FrameStatus, FrameStream, GenicamError, GigeRegisterIo, StandardFeature,
    StreamOptions, blocking,
};

use super::{BayerPattern, Camera, CameraError, Frame, GigeSettings};

/// How long cameras are looked for.
const SEARCH: Duration = Duration::from_secs(1);
/// Features that would change a photograph by themselves. Cameras have any of them or none.
const AUTOMATICS: [&str; 3] = ["ExposureAuto", "GainAuto", "BalanceWhiteAuto"];
/// Said where the camera no longer answers.
const LOST: &str =
    "Check its power and cable and that no other program has taken it, then resume the session.";

/// A camera that waits for software triggers. Its exposure and gain are fixed, its automatics off, and its frames raw 8-bit
/// mosaics.
pub(super) struct GigeCamera {
    stream: FrameStream,
    camera: Genicam<GigeRegisterIo>,
    size: (u32, u32),
    pattern: BayerPattern,
    exposure_us: f64,
    /// Multiple of `exposure_us` that is set.
    multiple: f64,
    patience: Duration,
}

impl GigeCamera {
    /// Finds the camera of these settings, which are within their ranges, and makes it wait for triggers.
    pub(super) fn open(settings: &GigeSettings) -> Result<GigeCamera, CameraError> {
        let device = find(settings)?;
        let mut camera = blocking::connect(&device).map_err(|error| CameraError::Failed {
            problem: format!("{}: {error}", device.ip),
            mend: "Close other programs that hold the camera, and wait some seconds after one that crashed.",
        })?;
        set(&mut camera, settings).map_err(|error| CameraError::Failed {
            problem: format!("{}: does not take its settings: {error}", device.ip),
            mend: "Compare the settings with the camera's manual.",
        })?;
        let side = |name| {
            let side = camera.get_integer(name).map_err(|error| lost(&error))?;
            u32::try_from(side).ok().filter(|side| (1..=1 << 16).contains(side)).ok_or_else(|| {
                CameraError::Failed {
                    problem: format!("{}: its {name} is {side}", device.ip),
                    mend: "Set the camera to an image of 1 to 65536 pixels a side.",
                }
            })
        };
        let size = (side("Width")?, side("Height")?);
        let [width, height] = settings.size;
        if size != (width, height) {
            let problem = format!("{}: its image is {}x{}, not {width}x{height}", device.ip, size.0, size.1);
            let mend = "Give its size in the rig file, or set the camera to that one by its maker's program.";
            return Err(CameraError::Failed { problem, mend });
        }
        let stream = start(&mut camera, settings).map_err(|error| CameraError::Failed {
            problem: format!("{}: no stream: {error}", device.ip),
            mend: "Let UDP from the camera through the firewall, and lower packet-size.",
        })?;
        Ok(GigeCamera {
            stream,
            camera,
            size,
            pattern: settings.pattern,
            exposure_us: settings.exposure_microseconds,
            multiple: 1.0,
            patience: Duration::from_secs_f64(settings.patience_seconds),
        })
    }

    /// Why no frame came: because the camera is gone, or because its packets were lost.
    fn missing(&self) -> CameraError {
        match self.camera.transport().refresh_control_state() {
            Ok(ControlState::Held) => CameraError::Incomplete("none arrived in time".to_owned()),
            Ok(state) => CameraError::Failed {
                problem: format!("it is no longer ours to control ({state:?})"),
                mend: LOST,
            },
            Err(error) => lost(&error),
        }
    }
}

impl Camera for GigeCamera {
    fn size(&self) -> (u32, u32) {
        self.size
    }

    fn shoot(&mut self) -> Result<Frame, CameraError> {
        // What still comes of an earlier trigger is not this photograph.
        while let Ok(Some(_)) = self.stream.next_frame_blocking(Duration::ZERO) {}
        self.camera.trigger_software().map_err(|error| lost(&error))?;
        let exposure = Duration::from_secs_f64(self.exposure_us * self.multiple * 1e-6);
        let frame = match self.stream.next_frame_blocking(self.patience + exposure) {
            Ok(Some(frame)) => frame,
            Ok(None) | Err(GenicamError::Timeout(_)) => return Err(self.missing()),
            Err(error) => return Err(lost(&error)),
        };
        match frame.status {
            FrameStatus::Complete => {}
            status => return Err(CameraError::Incomplete(format!("{status:?}"))),
        }
        let (expected, came) = (pixel_format(self.pattern).0, frame.pixel_format);
        if came != expected || (frame.width, frame.height) != self.size {
            let problem = format!("a frame of {}x{} {came} came", frame.width, frame.height);
            return Err(CameraError::Failed {
                problem,
                mend: "Let no other program set the camera meanwhile.",
            });
        }
        // Lines may be padded.
        let (width, stride) = (frame.width as usize, frame.width as usize + usize::from(frame.padding_x));
        let lines = frame.payload.chunks(stride).take(frame.height as usize);
        let data = lines.flat_map(|line| line.get(..width).unwrap_or(line)).copied().collect();
        Ok(Frame::Raw { width: frame.width, height: frame.height, pattern: self.pattern, data })
    }

    fn expose(&mut self, multiple: f64) -> Result<(), CameraError> {
        if multiple != self.multiple {
            self.camera.set_exposure_time(self.exposure_us * multiple).map_err(|error| {
                CameraError::Failed {
                    problem: format!("it cannot expose for {} us: {error}", self.exposure_us * multiple),
                    mend: "Choose exposures that the camera can do.",
                }
            })?;
            self.multiple = multiple;
        }
        Ok(())
    }
}

impl Drop for GigeCamera {
    fn drop(&mut self) {
        // It may be gone; there is nobody left to tell.
        let _ = self.camera.acquisition_stop();
    }
}

/// The camera of that address or serial number.
fn find(settings: &GigeSettings) -> Result<DeviceInfo, CameraError> {
    let failed = |problem: String| CameraError::Failed {
        problem,
        mend: "Check power and cable, that the camera's address lies in this network, and the firewall (UDP 3956).",
    };
    let told = |error: GenicamError| failed(error.to_string());
    if let Some(address) = settings.address {
        let found = blocking::discover_ip(address, SEARCH).map_err(told)?;
        return found.ok_or_else(|| failed(format!("no camera answers at {address}")));
    }
    let wanted = settings.serial.as_deref().unwrap_or_default();
    let options = DiscoveryOptions::new().include_loopback(true);
    let all = blocking::discover_with(SEARCH, &options).map_err(told)?;
    let known: Vec<(Ipv4Addr, String)> =
        all.iter().map(|device| (device.ip, device.serial.clone().unwrap_or_default())).collect();
    all.into_iter().find(|device| device.serial.as_deref() == Some(wanted)).ok_or_else(|| {
        let known: Vec<String> = known.iter().map(|(ip, serial)| format!("{serial} at {ip}")).collect();
        let known = if known.is_empty() { "none".to_owned() } else { known.join(", ") };
        failed(format!("no camera has the serial number {wanted}; found: {known}"))
    })
}

/// Writes all that stays as it is.
fn set(camera: &mut Genicam<GigeRegisterIo>, settings: &GigeSettings) -> Result<(), GenicamError> {
    // A camera that still runs for a program that crashed does not let itself be set; one that stands does not mind.
    let _ = camera.acquisition_stop();
    for name in AUTOMATICS {
        if camera.nodemap().node(name).is_some() {
            camera.set_enum(name, "Off")?;
        }
    }
    camera.set_enum("PixelFormat", pixel_format(settings.pattern).1)?;
    camera.set_acquisition_mode("Continuous")?;
    camera.set_exposure_time(settings.exposure_microseconds)?;
    if let Some(gain) = settings.gain {
        camera.set_gain(gain)?;
    }
    camera.resolve(StandardFeature::TriggerSoftware)?;
    camera.enable_trigger("FrameStart", "Software")
}

/// Opens the stream and lets the camera wait.
fn start(camera: &mut Genicam<GigeRegisterIo>, settings: &GigeSettings) -> Result<FrameStream, GenicamError> {
    let mut options = StreamOptions::new();
    if let Some(size) = settings.packet_size {
        options = options.packet_size(size);
    }
    if let Some(delay) = settings.packet_delay_microseconds {
        options = options.packet_delay(Duration::from_secs_f64(delay * 1e-6));
    }
    let mut stream = camera.open_stream(options)?;
    // Told at once of a torn frame, the session need not wait until time is up.
    stream.set_deliver_incomplete(true);
    camera.acquisition_start()?;
    Ok(stream)
}

/// The pixel format of a mosaic, and its name.
fn pixel_format(pattern: BayerPattern) -> (PixelFormat, &'static str) {
    match pattern {
        BayerPattern::Rggb => (PixelFormat::BayerRG8, "BayerRG8"),
        BayerPattern::Bggr => (PixelFormat::BayerBG8, "BayerBG8"),
        BayerPattern::Grbg => (PixelFormat::BayerGR8, "BayerGR8"),
        BayerPattern::Gbrg => (PixelFormat::BayerGB8, "BayerGB8"),
    }
}

/// The camera does not answer.
fn lost(error: &GenicamError) -> CameraError {
    CameraError::Failed { problem: error.to_string(), mend: LOST }
}

#[cfg(test)]
mod tests;
