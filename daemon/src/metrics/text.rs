//! Prometheus' text format, version 0.0.4 (<https://prometheus.io/docs/instrumenting/exposition_formats/>).
//!
//! Families of samples, each with its help and its type. Written by us: the crates that write it are registries of live
//! counters, where we have one moment's numbers; and they know summaries either not at all or with a sum and a count,
//! which percentiles over the last frames do not have.

use std::fmt::{Display, Formatter, Write};

/// The format's name in HTTP.
pub(super) const CONTENT_TYPE: &str = "text/plain; version=0.0.4; charset=utf-8";

/// What a family's numbers are.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Only grows, until the daemon starts again.
    Counter,
    /// Goes up and down.
    Gauge,
    /// Quantiles, each sample with its label `quantile`.
    Summary,
}

impl Kind {
    fn as_str(self) -> &'static str {
        match self {
            Self::Counter => "counter",
            Self::Gauge => "gauge",
            Self::Summary => "summary",
        }
    }
}

/// A label's name and value.
pub(super) type Label<'a> = (&'static str, &'a str);

/// A number and what it is about.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sample<'a> {
    /// In the order in which they are written.
    pub(super) labels: Vec<Label<'a>>,
    /// In the unit of its family.
    pub(super) value: f64,
}

/// A page of metrics.
#[derive(Debug, Default)]
pub(super) struct Page(String);

impl Page {
    /// Adds a family; one without samples is left out.
    pub(super) fn family<'a>(
        &mut self,
        name: &str,
        kind: Kind,
        help: &str,
        samples: impl IntoIterator<Item = Sample<'a>>,
    ) {
        let mut samples = samples.into_iter().peekable();
        if samples.peek().is_none() {
            return;
        }
        self.line(format_args!("# HELP {name} {}", Escaped { text: help, quotes: false }));
        self.line(format_args!("# TYPE {name} {}", kind.as_str()));
        for sample in samples {
            self.line(format_args!("{name}{} {}", Labels(&sample.labels), Number(sample.value)));
        }
    }

    fn line(&mut self, line: std::fmt::Arguments<'_>) {
        // A string takes whatever it is given.
        let _ = writeln!(self.0, "{line}");
    }

    /// The page.
    pub(super) fn finish(self) -> String {
        self.0
    }
}

struct Labels<'a>(&'a [Label<'a>]);

impl Display for Labels<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        for (index, (name, text)) in self.0.iter().enumerate() {
            write!(f, "{}{name}=\"{}\"", if index == 0 { '{' } else { ',' }, Escaped { text, quotes: true })?;
        }
        if self.0.is_empty() { Ok(()) } else { f.write_char('}') }
    }
}

/// A text in which backslashes, ends of lines and, in labels, quotes are escaped.
struct Escaped<'a> {
    text: &'a str,
    quotes: bool,
}

impl Display for Escaped<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        self.text.chars().try_for_each(|c| match c {
            '\\' => f.write_str("\\\\"),
            '\n' => f.write_str("\\n"),
            '"' if self.quotes => f.write_str("\\\""),
            c => f.write_char(c),
        })
    }
}

struct Number(f64);

impl Display for Number {
    fn fmt(&self, f: &mut Formatter<'_>) -> std::fmt::Result {
        // What is not finite has names of its own there; `NaN` is the same.
        match self.0 {
            f64::INFINITY => f.write_str("+Inf"),
            f64::NEG_INFINITY => f.write_str("-Inf"),
            number => number.fmt(f),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_that_would_end_a_line_or_a_label_do_not() {
        let mut page = Page::default();
        let labels = vec![("name", "a\"b\\c\nd"), ("kind", "é")];
        page.family("x_total", Kind::Counter, "a \"b\\\nc", [Sample { labels, value: 16_777_217.0 }]);
        page.family("none", Kind::Gauge, "nothing", []);
        let numbers = [f64::INFINITY, f64::NEG_INFINITY, f64::NAN, -0.25];
        page.family("y", Kind::Gauge, "y", numbers.map(|value| Sample { labels: vec![], value }));
        let expected = "# HELP x_total a \"b\\\\\\nc\n# TYPE x_total counter\n\
                        x_total{name=\"a\\\"b\\\\c\\nd\",kind=\"é\"} 16777217\n\
                        # HELP y y\n# TYPE y gauge\ny +Inf\ny -Inf\ny NaN\ny -0.25\n";
        assert_eq!(page.finish(), expected);
    }
}
