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
