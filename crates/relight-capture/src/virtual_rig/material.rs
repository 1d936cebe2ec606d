//! What surfaces are made of.

use super::bsdf::Bsdf;
use super::error::{RigError, within};
use super::microfacet::{Interface, Microfacets};
use super::texture::Texture;

use glam::Vec3A;

/// A surface that is met again after a bounce is at least this rough: a smaller lamp image in a smaller mirror would be
/// found by so few samples that it would only be noise. Highlights that the camera sees itself are as sharp as they are;
/// caustics are blurred.
const ROUGH_AFTER_A_BOUNCE: f64 = 0.25;

/// What a surface is made of. All surfaces are two-sided. Colours are linear-light reflectances from 0 to 1; `alpha` is
/// the width of the GGX distribution (Walter et al. 2007), from 0.01 (nearly a mirror) to 1.
#[derive(Clone, Debug)]
pub enum Material {
    /// Matt: Lambert's law.
    Lambert {
        /// Share of light that is sent back.
        reflectance: Texture,
    },
    /// A clear rough coat over a matt base: plastic, lacquer, glaze. Light that enters the coat is reflected inside it again
    /// and again; none is lost but what the base absorbs.
    Glossy {
        /// Reflectance of the base.
        reflectance: Texture,
        /// Width of the coat's GGX distribution.
        alpha: f64,
        /// Index of refraction of the coat, 1.5 for most plastics.
        ior: f64,
    },
    /// A rough metal, with the light that its facets pass among themselves (Kulla and Conty 2017).
    Conductor {
        /// Reflectance at normal incidence; rises to one at grazing incidence (Schlick 1994).
        reflectance: Texture,
        /// Width of the GGX distribution.
        alpha: f64,
    },
    /// A thin sheet that scatters light evenly to both sides: paper, leaves, cloth.
    Translucent {
        /// Share of light that leaves on the side it came from.
        reflectance: Texture,
        /// Share of light that leaves on the other side; at most one together with the reflectance.
        transmittance: Texture,
    },
}

impl Material {
    /// A matt surface of one colour.
    pub fn matt(colour: [f32; 3]) -> Self {
        Self::Lambert { reflectance: colour.into() }
    }

    /// Plastic of one colour.
    pub fn plastic(colour: [f32; 3], alpha: f64) -> Self {
        Self::Glossy { reflectance: colour.into(), alpha, ior: 1.5 }
    }

    /// Metal of one colour.
    pub fn metal(colour: [f32; 3], alpha: f64) -> Self {
        Self::Conductor { reflectance: colour.into(), alpha }
    }
}

/// A material with its tables, ready for tracing.
#[derive(Debug)]
pub(super) enum Surface {
    Diffuse {
        reflectance: Texture,
        transmittance: Texture,
    },
    /// Facets where the camera sees them, and after a bounce.
    Microfacet {
        colour: Texture,
        facets: Box<[Microfacets; 2]>,
    },
}

impl Surface {
    pub(super) fn new(material: &Material) -> Result<Self, RigError> {
        let microfacet = |colour: &Texture, alpha: f64, interface: Interface| {
            within("the alpha of a material", alpha, [0.01, 1.0], "0.01 to 1")?;
            let facets =
                [alpha, alpha.max(ROUGH_AFTER_A_BOUNCE)].map(|alpha| Microfacets::new(alpha, interface));
            Ok(Self::Microfacet { colour: colour.clone(), facets: Box::new(facets) })
        };
        match material {
            Material::Lambert { reflectance } => Ok(Self::Diffuse {
                reflectance: reflectance.clone(),
                transmittance: Texture::Uniform([0.0; 3]),
            }),
            Material::Translucent { reflectance, transmittance } => {
                Ok(Self::Diffuse { reflectance: reflectance.clone(), transmittance: transmittance.clone() })
            }
            Material::Glossy { reflectance, alpha, ior } => {
                within("the index of refraction of a material", *ior, [1.01, 4.0], "1.01 to 4")?;
                microfacet(reflectance, *alpha, Interface::Dielectric { ior: *ior as f32 })
            }
            Material::Conductor { reflectance, alpha } => {
                microfacet(reflectance, *alpha, Interface::Conductor)
            }
        }
    }

    /// How the surface scatters light at one place; `after_a_bounce` where the camera does not see it itself.
    pub(super) fn bsdf(&self, uv: [f32; 2], position: Vec3A, after_a_bounce: bool) -> Bsdf<'_> {
        let sane = |colour: Vec3A| colour.clamp(Vec3A::ZERO, Vec3A::ONE);
        match self {
            Self::Diffuse { reflectance, transmittance } => {
                let reflectance = sane(reflectance.at(uv, position));
                let transmittance = sane(transmittance.at(uv, position)).min(Vec3A::ONE - reflectance);
                Bsdf::Diffuse { reflectance, transmittance }
            }
            Self::Microfacet { colour, facets } => {
                facets[usize::from(after_a_bounce)].bsdf(sane(colour.at(uv, position)))
            }
        }
    }
}
