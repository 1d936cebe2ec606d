//! How a GigE Vision camera is found and set.

use std::net::Ipv4Addr;

use serde::{Deserialize, Serialize};

use super::{BayerPattern, Camera, CameraError};

/// A GigE Vision camera: which one, and all that stays as it is for a whole session. Written as a table of a rig file, where
/// only the exposure, the size and one of `address` and `serial` have to stand.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, rename_all = "kebab-case")]
pub struct GigeSettings {
    /// The camera's IPv4 address.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub address: Option<Ipv4Addr>,
    /// The serial number that is printed on it, looked for on all networks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// Width and height of its image, pixels, as they are set in the camera.
    pub size: [u32; 2],
    /// Exposure, microseconds.
    pub exposure_microseconds: f64,
    /// Gain, in the camera's own unit: decibels by the standard names, a number of the maker's under `GainRaw`. Left out, the
    /// camera's own gain stays, with its automatic switched off.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gain: Option<f64>,
    /// How its colour filters lie.
    #[serde(default = "rggb")]
    pub pattern: BayerPattern,
    /// How long a photograph may take to arrive beside its exposure, seconds.
    #[serde(default = "two")]
    pub patience_seconds: f64,
    /// Largest packet of the stream, bytes with headers: 1500 goes through any network, 9000 where all of it has jumbo frames.
    /// Left out, as the camera is set.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub packet_size: Option<u32>,
    /// Pause between packets, microseconds, for several cameras on one link or a host that loses packets.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub packet_delay_microseconds: Option<f64>,
}

fn rggb() -> BayerPattern {
    BayerPattern::Rggb
}

fn two() -> f64 {
    2.0
}

impl GigeSettings {
    /// Finds the camera, sets it and makes it wait for triggers.
    ///
    /// # Errors
    /// If a setting is out of range, the camera is not there, belongs to another program or refuses a setting; also if this
    /// program was built without the feature `gige`.
    pub fn open(&self) -> Result<Box<dyn Camera>, CameraError> {
        self.check()?;
        #[cfg(feature = "gige")]
        return Ok(Box::new(super::gige::GigeCamera::open(self)?));
        #[cfg(not(feature = "gige"))]
        Err(CameraError::Failed {
            problem: "this program was built without GigE Vision".to_owned(),
            mend: "Build it with it: cargo build --release -p relight --features gige.",
        })
    }

    fn check(&self) -> Result<(), CameraError> {
        let failed = |problem: String, mend| Err(CameraError::Failed { problem, mend });
        if self.address.is_some() == self.serial.is_some() {
            let mend = "Give one of the two, so that the right camera is found.";
            return failed("neither or both of address and serial are given".to_owned(), mend);
        }
        let ranges = [
            ("exposure-microseconds", Some(self.exposure_microseconds), 1.0, 6e7),
            ("gain", self.gain, 0.0, 1e6),
            ("patience-seconds", Some(self.patience_seconds), 0.01, 600.0),
            ("packet-size", self.packet_size.map(f64::from), 576.0, 16_260.0),
            ("packet-delay-microseconds", self.packet_delay_microseconds, 0.0, 1e5),
        ];
        for (name, value, low, high) in ranges {
            if let Some(value) = value.filter(|value| !(low..=high).contains(value)) {
                return failed(
                    format!("{name} is {value}, not {low} to {high}"),
                    "Correct it in the rig file.",
                );
            }
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<GigeSettings, toml::de::Error> {
        toml::from_str(&format!("exposure-microseconds = 9000.0\nsize = [1440, 1080]\n{text}"))
    }

    #[test]
    fn little_has_to_be_said_and_nonsense_is_refused() {
        let settings = read("address = \"10.0.0.7\"").unwrap();
        assert_eq!(
            (settings.pattern, settings.patience_seconds, settings.gain),
            (BayerPattern::Rggb, 2.0, None)
        );
        assert!(settings.check().is_ok());
        let again: GigeSettings = toml::from_str(&toml::to_string(&settings).unwrap()).unwrap();
        assert_eq!(again, settings);
        assert!(read("address = \"10.0.0.7\"\nexposure = 3").is_err());
        assert!(read("address = \"10.0.0.700\"").is_err());
        for (text, problem) in [
            ("gain = 1.0", "neither or both"),
            ("address = \"10.0.0.7\"\nserial = \"21\"", "neither or both"),
            ("serial = \"21\"\npatience-seconds = nan", "patience-seconds is NaN, not 0.01 to 600"),
            ("serial = \"21\"\npacket-size = 10", "packet-size is 10"),
            ("serial = \"21\"\ngain = -1.0", "gain is -1"),
        ] {
            let error = read(text).unwrap().open().err().unwrap().to_string();
            assert!(error.contains(problem), "{error}");
        }
    }

    #[cfg(not(feature = "gige"))]
    #[test]
    fn a_program_without_gige_says_so() {
        let error = read("serial = \"21\"").unwrap().open().err().unwrap().to_string();
        assert!(error.contains("--features gige"), "{error}");
    }
}
