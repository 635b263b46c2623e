//! XML as `OpenSim` writes it.

/// A document, written from its beginning.
#[derive(Debug)]
pub(super) struct Xml {
    text: String,
    depth: usize,
}

impl Default for Xml {
    fn default() -> Self {
        Self {
            text: "<?xml version=\"1.0\" encoding=\"UTF-8\" ?>\n".to_owned(),
            depth: 0,
        }
    }
}

impl Xml {
    /// Begins an element; `tag` is its name and attributes.
    pub(super) fn open(&mut self, tag: &str) {
        self.line(&["<", tag, ">"]);
        self.depth += 1;
    }

    /// Begins an element with the attribute `name`.
    pub(super) fn open_named(&mut self, tag: &str, name: &str) {
        self.line(&["<", tag, " name=\"", &escaped(name), "\">"]);
        self.depth += 1;
    }

    /// Ends an element.
    pub(super) fn close(&mut self, tag: &str) {
        self.depth = self.depth.saturating_sub(1);
        self.line(&["</", tag, ">"]);
    }

    /// An element that holds text.
    pub(super) fn leaf(&mut self, tag: &str, text: &str) {
        self.line(&["<", tag, ">", &escaped(text), "</", tag, ">"]);
    }

    /// A set of objects.
    pub(super) fn set(&mut self, tag: &str, name: &str, objects: impl FnOnce(&mut Self)) {
        self.open_named(tag, name);
        self.open("objects");
        objects(self);
        self.close("objects");
        self.close(tag);
    }

    /// All of it.
    pub(super) fn text(&self) -> &str {
        &self.text
    }

    fn line(&mut self, parts: &[&str]) {
        self.text.extend(std::iter::repeat_n('\t', self.depth));
        self.text.extend(parts.iter().copied());
        self.text.push('\n');
    }
}

fn escaped(text: &str) -> String {
    let mut safe = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => safe.push_str("&amp;"),
            '<' => safe.push_str("&lt;"),
            '>' => safe.push_str("&gt;"),
            '"' => safe.push_str("&quot;"),
            c => safe.push(c),
        }
    }
    safe
}
