//! XML formats of marker systems: attributes with the line in every error, and the choice of cameras that film video.

use farfield_proto::toml_file::FileError;
use roxmltree::{Document, ParsingOptions};

use super::camera::{Remark, RemarkKind};
use super::tree::Source;

/// Elements and texts of the largest file that is read.
const MOST_NODES: u32 = 200_000;

/// One element and its source.
#[derive(Clone, Copy)]
pub(super) struct Element<'a, 'd> {
    pub(super) source: Source<'a>,
    pub(super) node: roxmltree::Node<'d, 'd>,
}

pub(super) fn parse<'d>(source: &Source<'d>) -> Result<Document<'d>, FileError> {
    let options = ParsingOptions {
        nodes_limit: MOST_NODES,
        ..ParsingOptions::default()
    };
    let text = source.text.trim_start_matches('\u{feff}').trim_start();
    Document::parse_with_options(text, options).map_err(|error| {
        let line = usize::try_from(error.pos().row).unwrap_or(1);
        source
            .error(format!("not valid XML: {error}"))
            .at_line(line)
    })
}

impl<'d> Element<'_, 'd> {
    pub(super) fn error(&self, attribute: &str, problem: impl Into<String>) -> FileError {
        let position = self.node.document().text_pos_at(self.node.range().start);
        let field = format!("{}.{attribute}", self.node.tag_name().name());
        self.source
            .error(problem)
            .at_field(field)
            .at_line(usize::try_from(position.row).unwrap_or(1))
    }

    pub(super) fn children(&self, name: &str) -> Vec<Self> {
        let named = self.node.children().filter(|node| node.has_tag_name(name));
        named
            .map(|node| Self {
                source: self.source,
                node,
            })
            .collect()
    }

    pub(super) fn child(&self, name: &str) -> Option<Self> {
        self.children(name).into_iter().next()
    }

    pub(super) fn need_child(&self, name: &str) -> Result<Self, FileError> {
        self.child(name)
            .ok_or_else(|| self.error(name, format!("the element <{name}> is missing")))
    }

    pub(super) fn text(&self, attribute: &str) -> Option<&'d str> {
        self.node.attribute(attribute)
    }

    pub(super) fn need_text(&self, attribute: &str) -> Result<&'d str, FileError> {
        self.text(attribute)
            .ok_or_else(|| self.error(attribute, "the attribute is missing"))
    }

    pub(super) fn number(&self, attribute: &str) -> Result<f64, FileError> {
        let text = self.need_text(attribute)?;
        self.parse_number(attribute, text)
    }

    /// The number, or 0 if the attribute is missing.
    pub(super) fn number_or_zero(&self, attribute: &str) -> Result<f64, FileError> {
        self.text(attribute)
            .map_or(Ok(0.0), |text| self.parse_number(attribute, text))
    }

    fn parse_number(&self, attribute: &str, text: &str) -> Result<f64, FileError> {
        let number = text.trim().parse::<f64>().ok().filter(|n| n.is_finite());
        number.ok_or_else(|| {
            self.error(
                attribute,
                format!("found `{text}`, expected a finite number"),
            )
        })
    }

    /// Numbers with spaces between them.
    pub(super) fn numbers(&self, attribute: &str) -> Result<Vec<f64>, FileError> {
        let words = self.need_text(attribute)?.split_whitespace();
        words
            .map(|word| self.parse_number(attribute, word))
            .collect()
    }

    pub(super) fn fixed<const N: usize>(&self, attribute: &str) -> Result<[f64; N], FileError> {
        let list = self.numbers(attribute)?;
        list.try_into().map_err(|list: Vec<f64>| {
            self.error(
                attribute,
                format!("found {} numbers, expected {N}", list.len()),
            )
        })
    }
}

/// `text` escaped for an attribute.
pub(super) fn escaped(text: &str) -> String {
    text.replace('&', "&amp;")
        .replace('<', "&lt;")
        .replace('"', "&quot;")
}

/// Whether a camera films.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Films {
    /// The file states it, or does not state the model.
    Known,
    /// The model is unknown.
    Perhaps,
    /// It sees markers only, or its picture is empty.
    Never,
}

/// Whether each camera, given with its name and model, is used; uncertain decisions add a remark.
///
/// Unknown models are used: a list of models is soon outdated, and a missing camera is worse than an additional one.
pub(super) fn select_filming(
    cameras: &[(&str, String, Films)],
    remarks: &mut Vec<Remark>,
) -> Vec<bool> {
    let some_film = cameras.iter().any(|(_, _, films)| *films != Films::Never);
    let decide = |(name, model, films): &(&str, String, Films)| {
        let text = match films {
            Films::Known => return true,
            Films::Perhaps => format!("model `{model}` is not known: taken, as it may film"),
            Films::Never if some_film => {
                format!("model `{model}` sees markers and films no video: left out")
            }
            Films::Never => {
                format!("model `{model}` sees markers and films no video, like all others: taken")
            }
        };
        remarks.push(Remark::of_camera(RemarkKind::Assumed, name, text));
        *films != Films::Never || !some_film
    };
    cameras.iter().map(decide).collect()
}

/// The words of a model in lower case.
pub(super) fn words(model: &str) -> Vec<String> {
    let words = model.split(|c: char| !c.is_alphanumeric());
    words.map(str::to_lowercase).collect()
}
