//! Past values of chosen angles, for the start of a plot.

use farfield_proto::tick::Tick;
use serde::Serialize;

use crate::protocol::text::json;
use crate::state::Shared;

/// Maximum number of angles per response.
const MAX_ANGLES: usize = 8;
/// Maximum number of ticks per response.
const MAX_TICKS: usize = 4000;
/// Default duration, seconds.
const USUAL_S: f64 = 10.0;

/// A parsed query.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct SeriesQuery {
    person: u32,
    angles: Vec<u16>,
    from: Option<Tick>,
    to: Option<Tick>,
}

/// Why a query is invalid.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{field}`: found {found:?}, expected {expected}")]
pub(crate) struct QueryError {
    field: String,
    found: String,
    expected: String,
}

#[derive(Serialize)]
struct Series<'a> {
    session: Option<u32>,
    person: u32,
    angles: &'a [u16],
    ticks: Vec<Tick>,
    values: Vec<Vec<f32>>,
    unobserved: Vec<Vec<u16>>,
}

/// Parses the query `person=3&angles=12,13&from=1000&to=1600`.
pub(crate) fn parse(text: &str) -> Result<SeriesQuery, QueryError> {
    let wrong = |field: &str, found: &str, expected: &str| QueryError {
        field: field.to_owned(),
        found: found.to_owned(),
        expected: expected.to_owned(),
    };
    let mut query = SeriesQuery {
        person: 0,
        angles: Vec::new(),
        from: None,
        to: None,
    };
    let mut has_person = false;
    for pair in text.split('&').filter(|pair| !pair.is_empty()) {
        let (field, value) = pair.split_once('=').unwrap_or((pair, ""));
        let tick = || {
            value
                .parse()
                .map(Tick)
                .map_err(|_| wrong(field, value, "a tick"))
        };
        match field {
            "person" => {
                query.person = value.parse().map_err(|_| wrong(field, value, "an id"))?;
                has_person = true;
            }
            "angles" => {
                // A browser may encode the comma as %2C.
                let list = value.replace("%2C", ",").replace("%2c", ",");
                let angles: Result<Vec<u16>, _> = list.split(',').map(str::parse).collect();
                query.angles = angles.map_err(|_| wrong(field, value, "numbers of angles"))?;
            }
            "from" => query.from = Some(tick()?),
            "to" => query.to = Some(tick()?),
            _ => return Err(wrong(field, value, "person, angles, from or to")),
        }
    }
    if !has_person {
        return Err(wrong("person", "", "an id"));
    }
    if query.angles.is_empty() || query.angles.len() > MAX_ANGLES {
        let found = query.angles.len().to_string();
        return Err(wrong("angles", &found, "1 to 8 numbers of angles"));
    }
    Ok(query)
}

/// The response, as far as the past reaches.
pub(crate) fn answer(shared: &Shared, query: &SeriesQuery) -> String {
    let last = shared.past.span().map(|[_, last]| last);
    let to = query.to.or(last).unwrap_or_default();
    let usual = (USUAL_S * shared.context.venue.rate_hz) as i64;
    let from = query.from.unwrap_or(to + -usual);
    let mut series = Series {
        session: None,
        person: query.person,
        angles: &query.angles,
        ticks: Vec::new(),
        values: Vec::new(),
        unobserved: Vec::new(),
    };
    for frame in shared.past.range([from, to], MAX_TICKS) {
        series.session = Some(frame.session);
        let Some(angles) = frame.angles_of(query.person) else {
            continue;
        };
        let value = |angle: &u16| {
            angles
                .values
                .get(usize::from(*angle))
                .copied()
                .unwrap_or_default()
        };
        let is_unobserved = |angle: &&u16| **angle < 64 && angles.unobserved >> **angle & 1 == 1;
        series.ticks.push(frame.tick);
        series.values.push(query.angles.iter().map(value).collect());
        series
            .unobserved
            .push(query.angles.iter().filter(is_unobserved).copied().collect());
    }
    json(&series)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn queries_are_parsed_and_errors_name_the_field() {
        let query = parse("person=3&angles=12,13&from=1000&to=-1").unwrap();
        assert_eq!(
            query,
            SeriesQuery {
                person: 3,
                angles: vec![12, 13],
                from: Some(Tick(1000)),
                to: Some(Tick(-1))
            }
        );
        assert_eq!(parse("angles=1%2C2&person=3").unwrap().angles, [1, 2]);
        for (text, field) in [
            ("", "person"),
            ("person=x&angles=1", "person"),
            ("person=1", "angles"),
            ("person=1&angles=1,,2", "angles"),
            ("person=1&angles=1,2,3,4,5,6,7,8,9", "angles"),
            ("person=1&angles=1&from=now", "from"),
            ("person=1&angles=1&by=2", "by"),
        ] {
            assert_eq!(parse(text).unwrap_err().field, field, "{text}");
        }
    }

    proptest! {
        #[test]
        fn any_text_is_a_query_or_an_error(query in "[a-z0-9=&,%-]{0,80}") {
            let _result = parse(&query);
        }
    }
}
