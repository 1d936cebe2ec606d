//! What of a picture is shown: the maps, as 8-bit images and as plain numbers.

use std::fmt;
use std::str::FromStr;

use relight_field::engine::Outputs;
use relight_scene::Image;

use crate::error::RenderError;
use crate::picture::Picture;

/// One of the maps that a picture holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Map {
    /// The colour under the light.
    Final,
    /// How much of the light arrives, `o`.
    Visibility,
    /// The colour before visibility, `c`.
    Reflectance,
    /// Distance from the camera along the ray.
    Depth,
    /// Share of the ray's weight inside the field's box.
    Opacity,
}

impl Map {
    /// All maps.
    pub const ALL: [Map; 5] = [Map::Final, Map::Visibility, Map::Reflectance, Map::Depth, Map::Opacity];

    fn name(self) -> &'static str {
        match self {
            Map::Final => "final",
            Map::Visibility => "visibility",
            Map::Reflectance => "reflectance",
            Map::Depth => "depth",
            Map::Opacity => "opacity",
        }
    }

    /// What an engine must be asked for so that the picture holds this map.
    pub fn outputs(self) -> Outputs {
        Outputs { visibility: self == Map::Visibility, reflectance: self == Map::Reflectance }
    }
}

impl fmt::Display for Map {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Map {
    type Err = RenderError;

    fn from_str(text: &str) -> Result<Map, RenderError> {
        Map::ALL
            .into_iter()
            .find(|map| map.name().eq_ignore_ascii_case(text))
            .ok_or_else(|| RenderError::UnknownMap(text.to_owned()))
    }
}

/// The numbers of a map.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Values<'a> {
    /// sRGB in 0..1.
    Colour(&'a [[f32; 3]]),
    /// A share in 0..1.
    Share(&'a [f32]),
    /// Metres.
    Distance(&'a [f32]),
}

impl Picture {
    /// The numbers of a map.
    pub(crate) fn values(&self, map: Map) -> Result<Values<'_>, RenderError> {
        let values = match map {
            Map::Final => Values::Colour(&self.colour),
            Map::Reflectance => Values::Colour(&self.reflectance),
            Map::Visibility => Values::Share(&self.visibility),
            Map::Opacity => Values::Share(&self.opacity),
            Map::Depth => Values::Distance(&self.depth),
        };
        let missing = match values {
            Values::Colour(colours) => colours.is_empty(),
            Values::Share(numbers) | Values::Distance(numbers) => numbers.is_empty(),
        };
        if missing { Err(RenderError::NoMap(map)) } else { Ok(values) }
    }

    /// A map as an 8-bit image: colours as they are, shares in grey, distances in the colours of Turbo (Mikhailov
    /// 2019) from red at `near_far[0]` metres to blue at `near_far[1]`, and black where the ray meets nothing in the
    /// box. Without `near_far` the picture's own [`near_far`](Picture::near_far) is taken; a film should take the first
    /// frame's for all.
    ///
    /// # Errors
    /// [`RenderError::NoMap`] if the picture does not hold the map.
    pub fn image(&self, map: Map, near_far: Option<[f32; 2]>) -> Result<Image, RenderError> {
        let data = match self.values(map)? {
            Values::Colour(colours) => colours.iter().flatten().map(|&c| byte(c)).collect(),
            Values::Share(numbers) => numbers.iter().flat_map(|&x| [byte(x); 3]).collect(),
            Values::Distance(depth) => {
                let [near, far] = near_far.unwrap_or_else(|| self.near_far());
                let span = (far - near).max(f32::MIN_POSITIVE);
                depth
                    .iter()
                    .zip(&self.opacity)
                    .flat_map(|(&depth, &opacity)| {
                        if is_surface(depth, opacity) { turbo(1.0 - (depth - near) / span) } else { [0; 3] }
                    })
                    .collect()
            }
        };
        Ok(Image { width: self.width, height: self.height, data })
    }

    /// Distances that bound 98 of 100 of those pixels that see a surface in the box, metres; 0 and 1 if none does.
    pub fn near_far(&self) -> [f32; 2] {
        let surfaces = self.depth.iter().zip(&self.opacity).filter(|&(&d, &o)| is_surface(d, o));
        let mut depths: Vec<f32> = surfaces.map(|(&depth, _)| depth).collect();
        depths.sort_unstable_by(f32::total_cmp);
        let at = |percent: usize| depths.get(depths.len().saturating_sub(1) * percent / 100).copied();
        [at(1).unwrap_or(0.0), at(99).unwrap_or(1.0)]
    }
}

fn is_surface(depth: f32, opacity: f32) -> bool {
    depth.is_finite() && opacity >= 0.5
}

/// 0..1 to 0..255, halves rounded up; what is not a number becomes 0.
fn byte(x: f32) -> u8 {
    (x.clamp(0.0, 1.0) * 255.0 + 0.5) as u8
}

/// Turbo's colour for 0 (blue) to 1 (red).
fn turbo(t: f32) -> [u8; 3] {
    let colour = colorous::TURBO.eval_continuous(f64::from(t.clamp(0.0, 1.0)));
    [colour.r, colour.g, colour.b]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_round_up_and_nonsense_is_black() {
        let bytes = [0.0, 0.5 / 255.0, 0.499 / 255.0, 1.0, 2.0, -1.0, f32::NAN, f32::INFINITY].map(byte);
        assert_eq!(bytes, [0, 1, 0, 255, 255, 0, 0, 255]);
    }

    #[test]
    fn names_read_back() {
        for map in Map::ALL {
            assert_eq!(map.to_string().parse::<Map>().unwrap(), map);
        }
        assert!("normals".parse::<Map>().unwrap_err().to_string().contains("reflectance"));
    }

    #[test]
    fn near_is_red_far_is_blue_and_nothing_is_black() {
        let picture = Picture {
            width: 4,
            height: 1,
            depth: vec![1.1, 1.9, f32::NAN, 9.0],
            opacity: vec![1.0, 0.9, 1.0, 0.1],
            ..Picture::default()
        };
        let data = picture.image(Map::Depth, Some([1.0, 2.0])).unwrap().data;
        assert!(data[0] > data[2], "near is red");
        assert!(data[5] > data[3], "far is blue");
        assert_eq!(data[6..], [0; 6]);
        assert_eq!(picture.near_far(), [1.1, 1.1]);
        assert!(matches!(picture.image(Map::Visibility, None), Err(RenderError::NoMap(Map::Visibility))));
    }
}
