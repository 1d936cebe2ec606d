//! Depths in a file, for the next start.
//!
//! The contents: distances of all maps, then the points, as f32, little endian. How many there are of each follows from
//! the scene, the settings and the length.

use relight_scene::{Bounds, CacheEntry, CacheKind, Intrinsics, PixelStore, Scene};

use crate::descriptor::reduced;
use crate::prior::{DepthMap, DepthPrior, GoOn, StereoSettings, reduction};

/// Raise the version whenever depths of the same scene come out otherwise: an older file would go on being used.
const DEPTHS: CacheKind = CacheKind { magic: *b"RELIGHTD", version: 2, ending: "depths" };

/// Where depths came from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Source {
    /// They were estimated now.
    Stereo,
    /// They were estimated at an earlier start.
    Cache,
}

impl DepthPrior {
    /// As [`estimate`](DepthPrior::estimate), to the last bit. Where the pixels of `store` are kept in the cache the depths
    /// are kept there too, for the next start with the same frames, cameras, lights, box and settings. A file that cannot
    /// be written or used is no error: depths are estimated.
    pub fn find(
        scene: &Scene,
        store: &PixelStore,
        bounds: &Bounds,
        settings: &StereoSettings,
        go_on: GoOn<'_>,
    ) -> Option<(Self, Source)> {
        let entry = entry(scene, store, bounds, settings);
        if let Some(prior) = entry.as_ref().and_then(|entry| open(entry, scene, store, settings)) {
            return Some((prior, Source::Cache));
        }
        let prior = Self::estimate(scene, store, bounds, settings, go_on)?;
        if let Some(entry) = entry
            && let Err(error) = entry.write(&bytes(&prior))
        {
            tracing::debug!(
                "{}: {error}: depths are estimated anew at the next start",
                entry.path().display()
            );
        }
        Some((prior, Source::Stereo))
    }
}

/// The place of the depths. Debug texts of numbers tell all that differ apart.
fn entry(
    scene: &Scene,
    store: &PixelStore,
    bounds: &Bounds,
    settings: &StereoSettings,
) -> Option<CacheEntry> {
    let more = format!("{:?}\n{:?}\n{bounds:?}\n{settings:?}\n", scene.cameras, scene.lights);
    store.cache_entry(DEPTHS, &more)
}

fn open(
    entry: &CacheEntry,
    scene: &Scene,
    store: &PixelStore,
    settings: &StereoSettings,
) -> Option<DepthPrior> {
    let scale = reduction(scene, store, settings)?;
    let lenses = (0..store.views()).map(|v| &scene.cameras[store.camera(v)].intrinsics);
    prior(&entry.read()?, lenses, scale)
}

fn bytes(prior: &DepthPrior) -> Vec<u8> {
    let distances = prior.maps.iter().flat_map(|map| &map.distances);
    distances.chain(prior.points.as_flattened()).flat_map(|number| number.to_le_bytes()).collect()
}

/// The depths in `bytes`, for photographs through some lenses that are reduced by a factor; `None` if there are not as
/// many as that makes.
fn prior<'a>(bytes: &[u8], lenses: impl Iterator<Item = &'a Intrinsics>, scale: usize) -> Option<DepthPrior> {
    let (mut numbers, []) = bytes.as_chunks::<4>() else { return None };
    let mut maps = Vec::new();
    for full in lenses {
        let size = reduced(full, scale);
        let (distances, rest) = numbers.split_at_checked(size[0] * size[1])?;
        maps.push(DepthMap::new(full, size, distances.iter().map(|&b| f32::from_le_bytes(b)).collect()));
        numbers = rest;
    }
    let (points, []) = numbers.as_chunks::<3>() else { return None };
    let points = points.iter().map(|point| point.map(f32::from_le_bytes)).collect();
    Some(DepthPrior { maps, points })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lens(width: u32, height: u32) -> Intrinsics {
        Intrinsics { width, height, fx: 9.0, fy: 9.0, cx: 3.0, cy: 2.0, distortion: Vec::new() }
    }

    fn bits(prior: &DepthPrior) -> Vec<u32> {
        let distances = prior.maps.iter().flat_map(|map| &map.distances);
        distances.chain(prior.points.as_flattened()).map(|number| number.to_bits()).collect()
    }

    #[test]
    fn bytes_of_a_wrong_length_are_no_depths() {
        let lenses = [lens(7, 5), lens(4, 9)];
        let maps = [(3 * 2, 0.5f32), (2 * 4, f32::from_bits(0xffc1_2345))];
        let distances: Vec<f32> = maps.iter().flat_map(|&(count, value)| vec![value; count]).collect();
        let points = [[1.0, -0.0, f32::MAX], [f32::MIN_POSITIVE, 2.0, 3.0]];
        let numbers = distances.iter().chain(points.as_flattened());
        let whole: Vec<u8> = numbers.clone().flat_map(|n| n.to_le_bytes()).collect();

        let read = |bytes: &[u8]| prior(bytes, lenses.iter(), 2);
        let found = read(&whole).unwrap();
        assert_eq!(bits(&found), numbers.map(|n| n.to_bits()).collect::<Vec<_>>());
        assert_eq!(bytes(&found), whole);
        let sizes: Vec<_> = found.maps.iter().map(|map| (map.width, map.height, map.ratio)).collect();
        assert_eq!(sizes, [(3, 2, [7.0 / 3.0, 2.5]), (2, 4, [2.0, 2.25])]);
        for length in 0..whole.len() {
            // Without one or both of the points, it is whole too.
            let whole_points = length >= 56 && (length - 56).is_multiple_of(12);
            assert_eq!(read(&whole[..length]).is_some(), whole_points, "{length}");
        }
    }
}
