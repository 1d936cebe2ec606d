//! What each model brings, at a glance: a line a split over the models, for the page.

use std::fmt::Write as _;

use crate::ablation::title;
use crate::report_page::escape;
use crate::results::{Method, Results};
use crate::scoring::SPLITS;

/// Size of the drawing, and of the frame in it.
const SIZE: [f64; 2] = [440.0, 240.0];
const LEFT: f64 = 34.0;
const RIGHT: f64 = 350.0;
const TOP: f64 = 16.0;
const BOTTOM: f64 = 204.0;
/// Least distance of the names at the lines' ends.
const APART: f64 = 15.0;

/// A drawing a scene on which several models were scored.
pub fn write(results: &Results) -> String {
    let charts: Vec<String> = results.scenes.iter().filter_map(|(scene, _)| chart(results, scene)).collect();
    if charts.is_empty() {
        String::new()
    } else {
        format!("<section class=\"charts\">{}</section>\n", charts.concat())
    }
}

/// The PSNR of each model that has one, by its place, for each split.
fn lines(results: &Results, scene: &str) -> Vec<(&'static str, Vec<(usize, f64)>)> {
    let of_split = SPLITS.map(|split| {
        let psnr =
            |model: &String| Some(results.entry(scene, &Method::Model(model.clone()), split)?.psnr.mean);
        let points = results.models.iter().enumerate().filter_map(|(i, model)| Some((i, psnr(model)?)));
        (title(split), points.filter(|(_, psnr)| psnr.is_finite()).collect())
    });
    of_split.into_iter().filter(|(_, points): &(_, Vec<_>)| points.len() > 1).collect()
}

fn chart(results: &Results, scene: &str) -> Option<String> {
    let lines = lines(results, scene);
    let all = lines.iter().flat_map(|(_, points)| points.iter().map(|p| p.1));
    let (lo, hi) = all.fold((f64::INFINITY, f64::NEG_INFINITY), |(lo, hi), v| (lo.min(v), hi.max(v)));
    if lines.is_empty() {
        return None;
    }
    let step =
        [0.1, 0.2, 0.5, 1.0, 2.0, 5.0].into_iter().find(|step| (hi - lo) / step <= 5.0).unwrap_or(10.0);
    let (lo, hi) = ((lo / step - 0.2).floor() * step, (hi / step + 0.2).ceil() * step);
    let x =
        |i: usize| LEFT + 16.0 + (RIGHT - LEFT - 32.0) * i as f64 / (results.models.len() - 1).max(1) as f64;
    let y = |psnr: f64| BOTTOM - (BOTTOM - TOP) * (psnr - lo) / (hi - lo);
    let name = escape(scene);
    let [width, height] = SIZE;
    let mut svg = format!(
        "<figure class=\"chart\"><svg viewBox=\"0 0 {width} {height}\" role=\"img\" aria-label=\"{name}: PSNR by model\">"
    );
    // Writing to a string cannot fail.
    for i in 0..=((hi - lo) / step).round() as usize {
        let tick = lo + i as f64 * step;
        let digits = usize::from(step < 1.0);
        let _ = write!(
            svg,
            "<path class=\"grid\" d=\"M{LEFT} {0:.1}H{RIGHT}\"/><text class=\"end\" x=\"{1}\" y=\"{2:.1}\">{tick:.digits$}</text>",
            y(tick),
            LEFT - 6.0,
            y(tick) + 4.0
        );
    }
    for (i, model) in results.models.iter().enumerate() {
        let _ = write!(
            svg,
            "<text class=\"middle\" x=\"{:.1}\" y=\"{}\">{}</text>",
            x(i),
            BOTTOM + 20.0,
            escape(&model.to_uppercase())
        );
    }
    let mut names: Vec<(f64, &str)> = Vec::new();
    for (split, points) in &lines {
        let class = split.to_lowercase();
        let path: Vec<String> =
            points.iter().map(|&(i, psnr)| format!("{:.1} {:.1}", x(i), y(psnr))).collect();
        let _ = write!(svg, "<path class=\"{class}\" d=\"M{}\"/>", path.join(" L"));
        for &(i, psnr) in points {
            let _ =
                write!(svg, "<circle class=\"{class}\" cx=\"{:.1}\" cy=\"{:.1}\" r=\"3.5\"/>", x(i), y(psnr));
        }
        names.extend(points.last().map(|&(_, psnr)| (y(psnr), *split)));
    }
    names.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut above = f64::NEG_INFINITY;
    for (y, split) in names {
        above = y.max(above + APART);
        let _ = write!(
            svg,
            "<text class=\"{}\" x=\"{}\" y=\"{:.1}\">{split}</text>",
            split.to_lowercase(),
            RIGHT + 6.0,
            above + 4.0
        );
    }
    let _ = write!(svg, "</svg><figcaption>{name}: PSNR in dB</figcaption></figure>");
    Some(svg)
}
