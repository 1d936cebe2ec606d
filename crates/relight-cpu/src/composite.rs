//! Compositing along one ray (paper equation 1, quadrature of Max 1995), forward and backward.

/// Weights of the samples of a ray: `optical` holds density times length; the last sample is opaque.
pub fn weights(optical: &[f32], weights: &mut [f32]) {
    let mut transmittance = 1f32;
    let last = optical.len() - 1;
    for (w, &depth) in weights[..last].iter_mut().zip(optical) {
        let through = transmittance * (-depth).exp();
        *w = transmittance - through;
        transmittance = through;
    }
    weights[last] = transmittance;
}

/// Turns gradients with respect to weights into gradients with respect to optical depths, in place. The last
/// sample is opaque whatever its density, so its gradient is zero.
pub fn backward(weights: &[f32], gradient: &mut [f32]) {
    let last = weights.len() - 1;
    let mut behind = gradient[last] * weights[last];
    let mut transmittance = weights[last];
    gradient[last] = 0.0;
    for (g, &w) in gradient[..last].iter_mut().zip(weights).rev() {
        let here = *g;
        // `transmittance` is what passes this sample; the weights behind it all carry it as a factor.
        *g = here * transmittance - behind;
        behind += here * w;
        transmittance += w;
    }
}

/// Adds the distortion loss (Barron et al. 2022, equation 15) with distances in units of `edge` to the weight
/// gradients, times `scale`; returns the loss.
pub fn distortion(
    weights: &[f32],
    t: &[f32],
    lengths: &[f32],
    edge: f32,
    scale: f32,
    gradient: &mut [f32],
) -> f32 {
    // sum_j w_j |s_i - s_j| by running sums over the sorted samples.
    let total: f32 = weights.iter().sum();
    let moment: f32 = weights.iter().zip(t).map(|(w, t)| w * t).sum();
    let (mut mass, mut first, mut loss) = (0f32, 0f32, 0f32);
    for i in 0..weights.len() {
        let (w, s) = (weights[i], t[i]);
        // Samples before i, then those after it.
        let spread = (s * mass - first) + ((moment - first - w * s) - s * (total - mass - w));
        mass += w;
        first += w * s;
        let width = lengths[i] / 3.0;
        loss += w * (spread + w * width) / edge;
        gradient[i] += scale * 2.0 * (spread + w * width) / edge;
    }
    loss
}

/// Adds the depth penalty to the weight gradients, times `scale`; returns it: `sum_i w_i u_i^2 / (1 + u_i^2)` with
/// `u_i` the distance of sample `i` from the expected depth in units of `margin`. A bounded penalty: a wrong depth
/// can be overruled.
pub fn depth_penalty(
    weights: &[f32],
    t: &[f32],
    depth: f32,
    margin: f32,
    scale: f32,
    gradient: &mut [f32],
) -> f32 {
    let mut loss = 0.0;
    for ((w, t), g) in weights.iter().zip(t).zip(gradient) {
        let u = (t - depth) / margin;
        let rho = u * u / (1.0 + u * u);
        loss += w * rho;
        *g += scale * rho;
    }
    loss
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use relight_field::compositing as reference;

    fn f64s(values: &[f32]) -> Vec<f64> {
        values.iter().map(|&v| f64::from(v)).collect()
    }

    fn assert_close(ours: &[f32], theirs: &[f64], tolerance: f64) {
        assert_eq!(ours.len(), theirs.len());
        for (a, b) in ours.iter().zip(theirs) {
            assert!((f64::from(*a) - b).abs() < tolerance, "{ours:?} {theirs:?}");
        }
    }

    /// Optical depths of samples from clear to opaque, with as many other numbers in 0..1.
    fn ray() -> impl Strategy<Value = (Vec<f32>, Vec<f32>)> {
        let optical = prop_oneof![Just(0f32), 0f32..0.1, 0f32..5.0, Just(1e20)];
        proptest::collection::vec((optical, 0f32..1.0), 2..40).prop_map(|v| v.into_iter().unzip())
    }

    /// A slab of constant density: the weight within depth `s` is `1 - exp(-sigma s)`, in closed form.
    #[test]
    fn constant_density_slab() {
        let (n, sigma, length) = (100, 3f32, 1.5f32);
        let mut optical = vec![sigma * length / n as f32; n];
        optical.push(0.0);
        let mut w = vec![f32::NAN; n + 1];
        weights(&optical, &mut w);
        let mut sum = 0.0;
        for (i, w) in w[..n].iter().enumerate() {
            sum += w;
            let depth = length * (i + 1) as f32 / n as f32;
            assert!((sum - (1.0 - (-sigma * depth).exp())).abs() < 1e-5);
        }
        assert!((w[n] - (-sigma * length).exp()).abs() < 1e-5);
    }

    proptest! {
        #[test]
        fn weights_share_out_one((optical, _) in ray()) {
            let mut w = vec![f32::NAN; optical.len()];
            weights(&optical, &mut w);
            prop_assert!(w.iter().all(|&w| w >= 0.0));
            prop_assert!((w.iter().sum::<f32>() - 1.0).abs() < 1e-5);
        }

        #[test]
        fn weights_and_their_gradient_equal_the_reference((optical, d_weight) in ray()) {
            let mut w = vec![f32::NAN; optical.len()];
            weights(&optical, &mut w);
            // With lengths of one, densities are optical depths.
            let ones = vec![1.0; optical.len()];
            let plain = reference::weights(&f64s(&optical), &ones);
            assert_close(&w, &plain.weight, 1e-6);
            let mut gradient = d_weight.clone();
            backward(&w, &mut gradient);
            assert_close(&gradient, &reference::weights_backward(&plain, &ones, &f64s(&d_weight)), 1e-5);
            prop_assert_eq!(gradient.last(), Some(&0.0));
        }

        #[test]
        fn penalties_equal_the_reference((optical, lengths) in ray()) {
            let mut w = vec![f32::NAN; optical.len()];
            weights(&optical, &mut w);
            let t: Vec<f32> = lengths.iter().scan(0.3, |t, l| Some(std::mem::replace(t, *t + l))).collect();
            let (edge, scale, margin) = (2.5, 0.7, 0.05);
            let depth = t[t.len() / 2] + 0.01;
            let (w64, t64) = (f64s(&w), f64s(&t));
            // They add to what is there.
            let expected = |by_weight: Vec<f64>, unit: f64| -> Vec<f64> {
                by_weight.iter().map(|d| 1.0 + f64::from(scale) * d / unit).collect()
            };

            let mut gradient = vec![1.0; w.len()];
            let loss = distortion(&w, &t, &lengths, edge, scale, &mut gradient);
            let (plain, by_weight) = reference::distortion(&w64, &t64, &f64s(&lengths));
            prop_assert!((f64::from(loss) - plain / f64::from(edge)).abs() < 1e-4);
            assert_close(&gradient, &expected(by_weight, f64::from(edge)), 1e-4);

            let mut gradient = vec![1.0; w.len()];
            let loss = depth_penalty(&w, &t, depth, margin, scale, &mut gradient);
            let (plain, by_weight) =
                reference::depth_penalty(&w64, &t64, f64::from(depth), f64::from(margin));
            prop_assert!((f64::from(loss) - plain).abs() < 1e-4);
            assert_close(&gradient, &expected(by_weight, 1.0), 1e-4);
        }
    }
}
