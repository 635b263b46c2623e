//! Evaluates an inlet's query: a part of `XPath` 1.0 over the fields of the stream.
//!
//! `session_id='default' and (type='MoCap' or starts-with(name, 'farfield'))`: field names, texts,
//! numbers, `=`, `!=`, `<`, `<=`, `>`, `>=`, `and`, `or`, brackets, `not`, `contains`,
//! `starts-with`, `true`, `false`. Paths into the description are not supported. An unsupported
//! query matches no stream, as in `liblsl`.

/// Maximum depth of brackets.
const DEEPEST: usize = 32;
/// Functions with their number of arguments.
const FUNCTIONS: [(&str, usize); 5] = [
    ("not", 1),
    ("contains", 2),
    ("starts-with", 2),
    ("true", 0),
    ("false", 0),
];

/// Whether a stream with these `fields` matches `query`; an empty query matches all.
pub fn is_met(query: &str, fields: &[(&'static str, String)]) -> bool {
    let query = query.trim();
    if query.is_empty() {
        return true;
    }
    let Some(tokens) = tokens(query) else {
        return false;
    };
    let mut parser = Parser {
        tokens: &tokens,
        fields,
        depth: 0,
    };
    let met = parser.alternatives();
    met.is_some_and(|value| parser.tokens.is_empty() && value.is_true())
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Token<'a> {
    Text(&'a str),
    Number(f64),
    Name(&'a str),
    Sign(&'a str),
}

fn tokens(mut rest: &str) -> Option<Vec<Token<'_>>> {
    let mut tokens = Vec::new();
    loop {
        rest = rest.trim_start();
        let Some(first) = rest.chars().next() else {
            return Some(tokens);
        };
        let (token, after) = match first {
            '\'' | '"' => {
                let (text, after) = rest.get(1..)?.split_once(first)?;
                (Token::Text(text), after)
            }
            '0'..='9' | '.' => {
                let (number, after) = cut(rest, |c| c.is_ascii_digit() || c == '.');
                (Token::Number(number.parse().ok()?), after)
            }
            c if c.is_alphabetic() || c == '_' => {
                let (name, after) = cut(rest, |c| c.is_alphanumeric() || "_-.".contains(c));
                (Token::Name(name), after)
            }
            _ => {
                let signs = ["!=", "<=", ">=", "=", "<", ">", "(", ")", ","];
                let sign = signs.into_iter().find(|sign| rest.starts_with(sign))?;
                (Token::Sign(sign), rest.strip_prefix(sign)?)
            }
        };
        tokens.push(token);
        rest = after;
    }
}

/// Splits `text` after the leading characters for which `is_of` holds.
fn cut(text: &str, is_of: impl Fn(char) -> bool) -> (&str, &str) {
    let end = text.find(|c| !is_of(c)).unwrap_or(text.len());
    text.split_at_checked(end).unwrap_or((text, ""))
}

#[derive(Debug, Clone, PartialEq)]
enum Value<'a> {
    Truth(bool),
    Number(f64),
    Text(&'a str),
    /// A field, if the stream has it.
    Field(Option<&'a str>),
}

impl Value<'_> {
    fn is_true(&self) -> bool {
        match self {
            Self::Truth(truth) => *truth,
            Self::Number(number) => *number != 0.0 && !number.is_nan(),
            Self::Text(text) => !text.is_empty(),
            Self::Field(field) => field.is_some(),
        }
    }

    fn number(&self) -> f64 {
        match self {
            Self::Truth(truth) => f64::from(u8::from(*truth)),
            Self::Number(number) => *number,
            Self::Text(text) | Self::Field(Some(text)) => text.trim().parse().unwrap_or(f64::NAN),
            Self::Field(None) => f64::NAN,
        }
    }

    fn text(&self) -> &str {
        match self {
            Self::Text(text) | Self::Field(Some(text)) => text,
            _ => "",
        }
    }

    /// Compares as `XPath` does: with a missing field, every comparison is false, even `!=`.
    fn compare(&self, sign: &str, other: &Self) -> bool {
        if matches!(self, Self::Field(None)) || matches!(other, Self::Field(None)) {
            return false;
        }
        let is_one = |is: fn(&Self) -> bool| is(self) || is(other);
        let is_equal = if is_one(|it| matches!(it, Self::Truth(_))) {
            self.is_true() == other.is_true()
        } else if is_one(|it| matches!(it, Self::Number(_))) {
            let apart = self.number() - other.number();
            apart == 0.0
        } else {
            self.text() == other.text()
        };
        match sign {
            "=" => is_equal,
            "!=" => !is_equal,
            "<" => self.number() < other.number(),
            "<=" => self.number() <= other.number(),
            ">" => self.number() > other.number(),
            _ => self.number() >= other.number(),
        }
    }
}

/// Parses tokens from the left; `None` means that the query is not supported.
struct Parser<'t, 'a> {
    tokens: &'t [Token<'a>],
    fields: &'a [(&'static str, String)],
    depth: usize,
}

impl<'a> Parser<'_, 'a> {
    fn next(&mut self) -> Option<Token<'a>> {
        let (first, rest) = self.tokens.split_first()?;
        self.tokens = rest;
        Some(*first)
    }

    /// Consumes the next token if it is this one.
    fn take(&mut self, token: Token<'_>) -> bool {
        let is_it = self.tokens.first() == Some(&token);
        if is_it {
            self.next();
        }
        is_it
    }

    fn alternatives(&mut self) -> Option<Value<'a>> {
        let mut value = self.conditions()?;
        while self.take(Token::Name("or")) {
            let other = self.conditions()?;
            value = Value::Truth(value.is_true() || other.is_true());
        }
        Some(value)
    }

    fn conditions(&mut self) -> Option<Value<'a>> {
        let mut value = self.comparison(&["=", "!="])?;
        while self.take(Token::Name("and")) {
            let other = self.comparison(&["=", "!="])?;
            value = Value::Truth(value.is_true() && other.is_true());
        }
        Some(value)
    }

    /// Equality binds less tightly than order.
    fn comparison(&mut self, signs: &[&str]) -> Option<Value<'a>> {
        let is_equality = signs.contains(&"=");
        let operand = |parser: &mut Self| {
            if is_equality {
                parser.comparison(&["<", "<=", ">", ">="])
            } else {
                parser.operand()
            }
        };
        let mut value = operand(self)?;
        while let Some(sign) = signs.iter().find(|sign| self.take(Token::Sign(sign))) {
            let other = operand(self)?;
            value = Value::Truth(value.compare(sign, &other));
        }
        Some(value)
    }

    fn operand(&mut self) -> Option<Value<'a>> {
        match self.next()? {
            Token::Text(text) => Some(Value::Text(text)),
            Token::Number(number) => Some(Value::Number(number)),
            Token::Sign("(") => {
                let value = self.inside(Self::alternatives)?;
                self.take(Token::Sign(")")).then_some(value)
            }
            Token::Sign(_) => None,
            Token::Name(name) if self.take(Token::Sign("(")) => {
                let arguments = self.inside(Self::arguments)?;
                call(name, &arguments)
            }
            Token::Name(name) => {
                let field = self.fields.iter().find(|(known, _)| *known == name);
                Some(Value::Field(field.map(|(_, value)| value.as_str())))
            }
        }
    }

    fn inside<T>(&mut self, read: impl Fn(&mut Self) -> Option<T>) -> Option<T> {
        if self.depth == DEEPEST {
            return None;
        }
        self.depth += 1;
        let value = read(self);
        self.depth -= 1;
        value
    }

    fn arguments(&mut self) -> Option<Vec<Value<'a>>> {
        let mut arguments = Vec::new();
        if self.take(Token::Sign(")")) {
            return Some(arguments);
        }
        loop {
            arguments.push(self.alternatives()?);
            match self.next()? {
                Token::Sign(")") => return Some(arguments),
                Token::Sign(",") => {}
                _ => return None,
            }
        }
    }
}

fn call<'a>(name: &str, arguments: &[Value<'a>]) -> Option<Value<'a>> {
    if !FUNCTIONS.contains(&(name, arguments.len())) {
        return None;
    }
    let truth = match (name, arguments) {
        ("not", [value]) => !value.is_true(),
        ("contains", [text, part]) => text.text().contains(part.text()),
        ("starts-with", [text, part]) => text.text().starts_with(part.text()),
        (name, _) => name == "true",
    };
    Some(Value::Truth(truth))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::lsl::info::tests::info;

    fn met(query: &str) -> bool {
        is_met(query, &info().fields())
    }

    #[test]
    fn matching_queries_find_the_stream() {
        for query in [
            "",
            "session_id='default'",
            "session_id='default' and type='MoCap'",
            "session_id=\"default\" and (type='EEG' or starts-with(name,'farfield-'))",
            "channel_count='713' and name='farfield-a <b> & c' and channel_format='float32'",
            "nominal_srate=60 and channel_count > 700 and nominal_srate <= 60.0",
            "not(type='EEG') and contains(hostname, 'a') and true()",
            "name",
        ] {
            assert!(met(query), "{query}");
        }
    }

    #[test]
    fn other_and_unsupported_queries_do_not_match() {
        for query in [
            "type='EEG'",
            "type!='MoCap'",
            "session_id='default' and type='EEG' or name='x'",
            "nothing",
            "nothing!='x'",
            "false()",
            "count(//channel)>3",
            "desc/manufacturer='x'",
            "type='MoCap",
            "type='MoCap' and",
            "type='MoCap')",
            "not()",
            "1.2.3",
        ] {
            assert!(!met(query), "{query}");
        }
    }

    #[test]
    fn deeply_nested_brackets_are_rejected() {
        assert!(met(&format!(
            "{}type='MoCap'{}",
            "(".repeat(32),
            ")".repeat(32)
        )));
        assert!(!met(&format!(
            "{}type='MoCap'{}",
            "(".repeat(33),
            ")".repeat(33)
        )));
        assert!(!met(&"not(".repeat(100_000)));
    }

    proptest! {
        #[test]
        fn no_query_panics(query in "[a-z_'\"()=!<>,. 0-9é-]{0,60}") {
            met(&query);
        }
    }
}
