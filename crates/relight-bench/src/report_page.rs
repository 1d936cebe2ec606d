//! Reports as one HTML file that holds its pictures and its video: nothing is fetched from elsewhere.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD;

/// A page that grows from top to bottom.
pub struct ReportPage {
    html: String,
}

/// What every page looks like: light or dark as the reader's system is, and readable on a phone.
const STYLE: &str = include_str!("report_page.css");

impl ReportPage {
    /// A page with a title.
    pub fn new(title: &str) -> Self {
        Self::styled(title, "")
    }

    /// A page with a title, and with a style sheet beside the usual one.
    pub(crate) fn styled(title: &str, style: &str) -> Self {
        let title = escape(title);
        let html = format!(
            "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\"><title>{title}</title>\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\"><style>\n{STYLE}{style}</style></head><body>\n<h1>{title}</h1>\n"
        );
        Self { html }
    }

    /// Adds a heading.
    pub fn heading(&mut self, text: &str) {
        self.add(format_args!("<h2>{}</h2>\n", escape(text)));
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.add(format_args!("<p>{}</p>\n", escape(text)));
    }

    /// Adds a paragraph that introduces the page.
    pub fn lead(&mut self, text: &str) {
        self.add(format_args!("<p class=\"lead\">{}</p>\n", escape(text)));
    }

    /// Adds a paragraph that must not be missed.
    pub fn warning(&mut self, text: &str) {
        self.add(format_args!("<p class=\"warning\" role=\"status\">{}</p>\n", escape(text)));
    }

    /// Adds remarks.
    pub fn remarks(&mut self, remarks: &[String]) {
        self.html.push_str("<ul class=\"remarks\">\n");
        for remark in remarks {
            self.add(format_args!("<li>{}</li>\n", escape(remark)));
        }
        self.html.push_str("</ul>\n");
    }

    /// Adds HTML that is known to be well-formed.
    pub(crate) fn html(&mut self, html: &str) {
        self.html.push_str(html);
    }

    /// Adds lines to be typed.
    pub fn code(&mut self, text: &str) {
        self.add(format_args!("<pre>{}</pre>\n", escape(text)));
    }

    /// Adds a table; the first row is its head.
    pub fn table(&mut self, rows: &[Vec<String>]) {
        self.html.push_str("<div class=\"scroll\"><table>");
        for (i, row) in rows.iter().enumerate() {
            let cell = if i == 0 { "th" } else { "td" };
            self.html.push_str("<tr>");
            for text in row {
                self.add(format_args!("<{cell}>{}</{cell}>", escape(text)));
            }
            self.html.push_str("</tr>\n");
        }
        self.html.push_str("</table></div>\n");
    }

    /// Adds pictures side by side: PNG files in memory, each with a caption.
    pub fn pictures(&mut self, pictures: &[(Vec<u8>, String)]) {
        self.html.push_str("<div class=\"row\">\n");
        for (png, caption) in pictures {
            let (caption, source) = (escape(caption), source(png));
            self.add(format_args!(
                "<figure><img alt=\"{caption}\" src=\"{source}\"><figcaption>{caption}</figcaption></figure>\n"
            ));
        }
        self.html.push_str("</div>\n");
    }

    /// Adds an MP4 video in memory.
    pub fn video(&mut self, mp4: &[u8]) {
        let data = STANDARD.encode(mp4);
        self.add(format_args!(
            "<video controls autoplay loop muted src=\"data:video/mp4;base64,{data}\"></video>\n"
        ));
    }

    /// Adds a curve through `points`, which must be in the order of x.
    pub fn curve(&mut self, x_name: &str, y_name: &str, points: &[(f64, f64)]) {
        let range = |values: &mut dyn Iterator<Item = f64>| {
            let (lo, hi) = values.fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), v| (l.min(v), h.max(v)));
            (lo, if hi > lo { hi } else { lo + 1.0 })
        };
        if points.is_empty() {
            return;
        }
        let (_, x1) = range(&mut points.iter().map(|p| p.0));
        let (y0, y1) = range(&mut points.iter().map(|p| p.1));
        let place = |&(x, y): &(f64, f64)| (60.0 + 520.0 * x / x1, 190.0 - 170.0 * (y - y0) / (y1 - y0));
        let mut path = String::new();
        for (i, point) in points.iter().enumerate() {
            let (x, y) = place(point);
            // Writing to a string cannot fail.
            let _ = write!(path, "{}{x:.1} {y:.1}", if i == 0 { "M" } else { " L" });
        }
        self.add(format_args!(
            "<svg viewBox=\"0 0 600 240\" role=\"img\" aria-label=\"{y_name} against {x_name}\" fill=\"none\" \
             font-size=\"13\"><path d=\"M60 20V190H580\" stroke=\"#888\"/><path d=\"{path}\" stroke=\"#c60\" \
             stroke-width=\"2\"/><g fill=\"#888\"><text x=\"52\" y=\"28\" text-anchor=\"end\">{y1:.1}</text>\
             <text x=\"52\" y=\"194\" text-anchor=\"end\">{y0:.1}</text><text x=\"580\" y=\"208\" \
             text-anchor=\"end\">{x1:.0}</text><text x=\"320\" y=\"226\" text-anchor=\"middle\">{y_name} against {x_name}\
             </text></g></svg>\n"
        ));
    }

    /// The whole page.
    pub fn finish(mut self) -> String {
        self.html.push_str("</body></html>\n");
        self.html
    }

    fn add(&mut self, text: std::fmt::Arguments<'_>) {
        // Writing to a string cannot fail.
        let _ = self.html.write_fmt(text);
    }
}

/// The bytes of a PNG or JPEG file, as the source of a picture.
pub(crate) fn source(bytes: &[u8]) -> String {
    let kind = if bytes.starts_with(&[0xff, 0xd8]) { "jpeg" } else { "png" };
    format!("data:image/{kind};base64,{}", STANDARD.encode(bytes))
}

/// A text that means itself, between tags and in quotes.
pub(crate) fn escape(text: &str) -> String {
    text.replace('&', "&amp;").replace('<', "&lt;").replace('>', "&gt;").replace('"', "&quot;")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_escaped_and_pictures_are_embedded() {
        let mut page = ReportPage::new("a < b");
        page.pictures(&[(b"png".to_vec(), "\"quoted\"".to_owned())]);
        page.curve("step", "PSNR", &[(1.0, 20.0), (2.0, 25.0)]);
        let html = page.finish();
        assert!(html.contains("<h1>a &lt; b</h1>"));
        assert!(html.contains("data:image/png;base64,cG5n") && html.contains("&quot;quoted&quot;"));
        assert!(html.contains("M320.0 190.0 L580.0 20.0"), "{html}");
        assert!(html.ends_with("</body></html>\n"));
    }
}
