//! The joint least-squares fit of one lens and many viewpoints (a bundle adjustment of a known board).

use nalgebra::{Cholesky, SMatrix, SVector};

use super::lens::{LENS, Lens};
use super::viewpoint::{Sighting, VIEWPOINT, Viewpoint};

const STEPS: usize = 200;
/// Relative fall of the cost below which the fit has ended.
const CONVERGED: f64 = 1e-13;
const FIRST_DAMPING: f64 = 1e-3;
/// Damping beyond which no step helps.
const STUCK: f64 = 1e12;

/// A viewpoint and what was seen from it.
#[derive(Clone, Debug)]
pub(super) struct View {
    pub(super) viewpoint: Viewpoint,
    pub(super) sightings: Vec<Sighting>,
}

/// Standard errors that the residuals and the geometry imply.
pub(super) struct Covariance {
    /// Covariance of the lens's parameters; nothing for those that are held.
    pub(super) lens: LensBlock,
    /// Covariance of each viewpoint, the lens's own uncertainty included.
    pub(super) viewpoints: Vec<SMatrix<f64, VIEWPOINT, VIEWPOINT>>,
    /// The lens's normal equations, the viewpoints eliminated, square pixels: what these views tell of it.
    pub(super) information: LensBlock,
    /// Variance of one coordinate of a corner, square pixels.
    pub(super) variance: f64,
}

/// What is known of the lens beside the views.
#[derive(Clone, Debug)]
pub(super) struct Knowledge {
    /// Parameters that keep their value.
    pub(super) held: [bool; LENS],
    /// An earlier lens, and the [`information`](Covariance::information) that there was of it.
    pub(super) earlier: Option<(Lens, LensBlock)>,
}

/// The fit came to nothing: the views do not determine the lens.
#[derive(Debug)]
pub(super) struct Undetermined;

pub(super) type LensBlock = SMatrix<f64, LENS, LENS>;
type ViewBlock = SMatrix<f64, VIEWPOINT, VIEWPOINT>;
type Coupling = SMatrix<f64, LENS, VIEWPOINT>;

/// The normal equations, in the arrow shape that the Schur complement wants.
struct Equations {
    lens: LensBlock,
    lens_slope: SVector<f64, LENS>,
    views: Vec<(ViewBlock, Coupling, SVector<f64, VIEWPOINT>)>,
    cost: f64,
    /// Sum of weighted squares, and how many numbers went into it.
    squares: f64,
    count: usize,
}

/// Moves `lens` and all viewpoints to the least sum of Huber losses with the given threshold in pixels (Levenberg-Marquardt
/// with the viewpoints eliminated; Triggs et al., Bundle Adjustment: A Modern Synthesis, section 6.1).
pub(super) fn adjust(
    lens: &mut Lens,
    views: &mut [View],
    knowledge: &Knowledge,
    threshold: f64,
) -> Result<(), Undetermined> {
    let mut equations = knowledge.added(lens, linearise(lens, views, threshold)).ok_or(Undetermined)?;
    let mut damping = FIRST_DAMPING;
    for _ in 0..STEPS {
        let Some((lens_step, view_steps)) = solve(&equations, damping) else { return Err(Undetermined) };
        let next_lens = Lens(lens.0 + lens_step);
        let next_views: Vec<View> = views
            .iter()
            .zip(&view_steps)
            .map(|(view, step)| View { viewpoint: view.viewpoint.moved(step), ..view.clone() })
            .collect();
        match knowledge.added(&next_lens, linearise(&next_lens, &next_views, threshold)) {
            Some(next) if next.cost <= equations.cost => {
                let fall = equations.cost - next.cost;
                (*lens, equations) = (next_lens, next);
                views.clone_from_slice(&next_views);
                damping = (damping * 0.1).max(1e-12);
                if fall <= CONVERGED * equations.cost {
                    return Ok(());
                }
            }
            _ if damping > STUCK => return Ok(()),
            _ => damping *= 10.0,
        }
    }
    Ok(())
}

/// As [`adjust`], for one viewpoint and a lens that is known; also the viewpoint's covariance. `None` if the corners do not
/// determine the viewpoint.
pub(super) fn adjust_viewpoint(lens: &Lens, view: &mut View, threshold: f64) -> Option<ViewBlock> {
    let mut equations = linearise(lens, std::slice::from_ref(view), threshold)?;
    let mut damping = FIRST_DAMPING;
    for _ in 0..STEPS {
        let (block, _, slope) = equations.views.first()?;
        let step = Cholesky::new(damped(block, damping))?.solve(slope);
        let next = View { viewpoint: view.viewpoint.moved(&step), ..view.clone() };
        match linearise(lens, std::slice::from_ref(&next), threshold) {
            Some(next_equations) if next_equations.cost <= equations.cost => {
                let fall = equations.cost - next_equations.cost;
                (*view, equations) = (next, next_equations);
                damping = (damping * 0.1).max(1e-12);
                if fall <= CONVERGED * equations.cost {
                    break;
                }
            }
            _ if damping > STUCK => break,
            _ => damping *= 10.0,
        }
    }
    let variance = equations.variance(VIEWPOINT)?;
    Some(Cholesky::new(equations.views.first()?.0)?.inverse() * variance)
}

/// The covariance at the place that [`adjust`] has found.
pub(super) fn covariance(
    lens: &Lens,
    views: &[View],
    knowledge: &Knowledge,
    threshold: f64,
) -> Option<Covariance> {
    let equations = knowledge.added(lens, linearise(lens, views, threshold))?;
    let variance = equations.variance(knowledge.free() + VIEWPOINT * views.len())?;
    let (information, _) = eliminate(&equations, 0.0)?;
    let mut inverse = Cholesky::new(information)?.inverse();
    for i in (0..LENS).filter(|&i| knowledge.held[i]) {
        inverse[(i, i)] = 0.0;
    }
    let viewpoints = equations.views.iter().map(|(block, coupling, _)| {
        let own = Cholesky::new(*block)?.inverse();
        let carried = own * coupling.transpose();
        Some((own + carried * inverse * carried.transpose()) * variance)
    });
    let viewpoints = viewpoints.collect::<Option<_>>()?;
    Some(Covariance { viewpoints, lens: inverse * variance, information, variance })
}

impl Knowledge {
    pub(super) fn nothing() -> Knowledge {
        Knowledge { held: [false; LENS], earlier: None }
    }

    /// Number of parameters that are not held.
    fn free(&self) -> usize {
        self.held.iter().filter(|&&held| !held).count()
    }

    /// The equations with this knowledge in them. A parameter that is held has equations of its own, whose answer is no step.
    fn added(&self, lens: &Lens, equations: Option<Equations>) -> Option<Equations> {
        let mut equations = equations?;
        if let Some((earlier, information)) = &self.earlier {
            let step = information * (earlier.0 - lens.0);
            equations.lens += information;
            equations.lens_slope += step;
            equations.cost += 0.5 * (earlier.0 - lens.0).dot(&step);
        }
        for i in (0..LENS).filter(|&i| self.held[i]) {
            equations.lens.row_mut(i).fill(0.0);
            equations.lens.column_mut(i).fill(0.0);
            equations.lens[(i, i)] = 1.0;
            equations.lens_slope[i] = 0.0;
            equations.views.iter_mut().for_each(|(_, coupling, _)| coupling.row_mut(i).fill(0.0));
        }
        Some(equations)
    }
}

impl Equations {
    /// Variance of one coordinate of a corner, from the residuals; `None` without more numbers than parameters.
    fn variance(&self, parameters: usize) -> Option<f64> {
        (self.count > parameters).then(|| self.squares / (self.count - parameters) as f64)
    }
}

/// `None` if a corner falls behind its camera.
fn linearise(lens: &Lens, views: &[View], threshold: f64) -> Option<Equations> {
    let mut equations = Equations {
        lens: LensBlock::zeros(),
        lens_slope: SVector::zeros(),
        views: Vec::with_capacity(views.len()),
        cost: 0.0,
        squares: 0.0,
        count: 0,
    };
    for view in views {
        let (mut block, mut coupling, mut slope) = (ViewBlock::zeros(), Coupling::zeros(), SVector::zeros());
        for sighting in &view.sightings {
            let residual = view.viewpoint.residual(lens, sighting)?;
            let length = residual.pixels.norm();
            let weight = if length <= threshold { 1.0 } else { threshold / length };
            equations.cost += if length <= threshold {
                0.5 * length * length
            } else {
                threshold * (length - 0.5 * threshold)
            };
            let (by_lens, by_view) = (residual.by_lens, residual.by_viewpoint);
            equations.lens += by_lens.transpose() * by_lens * weight;
            equations.lens_slope += by_lens.transpose() * residual.pixels * weight;
            block += by_view.transpose() * by_view * weight;
            coupling += by_lens.transpose() * by_view * weight;
            slope += by_view.transpose() * residual.pixels * weight;
            equations.squares += weight * length * length;
            equations.count += 2;
        }
        equations.views.push((block, coupling, slope));
    }
    equations.cost.is_finite().then_some(equations)
}

/// Marquardt's damping: scale-free, as the parameters have many units.
fn damped<const N: usize>(block: &SMatrix<f64, N, N>, damping: f64) -> SMatrix<f64, N, N> {
    let mut damped = *block;
    for i in 0..N {
        damped[(i, i)] *= 1.0 + damping;
    }
    damped
}

/// The lens's equations once the viewpoints are eliminated.
fn eliminate(equations: &Equations, damping: f64) -> Option<(LensBlock, SVector<f64, LENS>)> {
    let (mut schur, mut slope) = (damped(&equations.lens, damping), equations.lens_slope);
    for (block, coupling, view_slope) in &equations.views {
        let factor = Cholesky::new(damped(block, damping))?;
        schur -= coupling * factor.solve(&coupling.transpose());
        slope -= coupling * factor.solve(view_slope);
    }
    Some((schur, slope))
}

type Steps = (SVector<f64, LENS>, Vec<SVector<f64, VIEWPOINT>>);

fn solve(equations: &Equations, damping: f64) -> Option<Steps> {
    let (schur, slope) = eliminate(equations, damping)?;
    let lens = Cholesky::new(schur)?.solve(&slope);
    let steps = equations.views.iter().map(|(block, coupling, view_slope)| {
        Some(Cholesky::new(damped(block, damping))?.solve(&(view_slope - coupling.transpose() * lens)))
    });
    Some((lens, steps.collect::<Option<_>>()?))
}
