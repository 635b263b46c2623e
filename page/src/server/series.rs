//! The past of chosen angles: what a plot begins with.

use farfield_proto::tick::Tick;
use serde::Serialize;

use crate::protocol::text::json;
use crate::state::Shared;

/// Most angles of one answer.
const MAX_ANGLES: usize = 8;
/// Most ticks of one answer.
const MAX_TICKS: usize = 4000;
/// What is given where nothing else is asked for, seconds.
const USUAL_S: f64 = 10.0;

/// What is asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct AskedSeries {
    person: u32,
    angles: Vec<u16>,
    from: Option<Tick>,
    to: Option<Tick>,
}

/// Why it is not understood.
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

/// Reads the query `person=3&angles=12,13&from=1000&to=1600`.
pub(crate) fn parse(query: &str) -> Result<AskedSeries, QueryError> {
    let wrong = |field: &str, found: &str, expected: &str| QueryError {
        field: field.to_owned(),
        found: found.to_owned(),
        expected: expected.to_owned(),
    };
    let mut asked = AskedSeries {
        person: 0,
        angles: Vec::new(),
        from: None,
        to: None,
    };
    let mut has_person = false;
    for pair in query.split('&').filter(|pair| !pair.is_empty()) {
        let (field, value) = pair.split_once('=').unwrap_or((pair, ""));
        let tick = || {
            value
                .parse()
                .map(Tick)
                .map_err(|_| wrong(field, value, "a tick"))
        };
        match field {
            "person" => {
                asked.person = value.parse().map_err(|_| wrong(field, value, "an id"))?;
                has_person = true;
            }
            "angles" => {
                // A browser may write the comma as %2C.
                let list = value.replace("%2C", ",").replace("%2c", ",");
                let angles: Result<Vec<u16>, _> = list.split(',').map(str::parse).collect();
                asked.angles = angles.map_err(|_| wrong(field, value, "numbers of angles"))?;
            }
            "from" => asked.from = Some(tick()?),
            "to" => asked.to = Some(tick()?),
            _ => return Err(wrong(field, value, "person, angles, from or to")),
        }
    }
    if !has_person {
        return Err(wrong("person", "", "an id"));
    }
    if asked.angles.is_empty() || asked.angles.len() > MAX_ANGLES {
        let found = asked.angles.len().to_string();
        return Err(wrong("angles", &found, "1 to 8 numbers of angles"));
    }
    Ok(asked)
}

/// The answer, as far as the past reaches.
pub(crate) fn answer(shared: &Shared, asked: &AskedSeries) -> String {
    let last = shared.past.span().map(|[_, last]| last);
    let to = asked.to.or(last).unwrap_or_default();
    let usual = (USUAL_S * shared.context.venue.rate_hz) as i64;
    let from = asked.from.unwrap_or(to + -usual);
    let mut series = Series {
        session: None,
        person: asked.person,
        angles: &asked.angles,
        ticks: Vec::new(),
        values: Vec::new(),
        unobserved: Vec::new(),
    };
    for frame in shared.past.range([from, to], MAX_TICKS) {
        series.session = Some(frame.session);
        let Some(angles) = frame.angles_of(asked.person) else {
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
        series.values.push(asked.angles.iter().map(value).collect());
        series
            .unobserved
            .push(asked.angles.iter().filter(is_unobserved).copied().collect());
    }
    json(&series)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_query_is_read_and_what_is_wrong_is_named() {
        let asked = parse("person=3&angles=12,13&from=1000&to=-1").unwrap();
        assert_eq!(
            asked,
            AskedSeries {
                person: 3,
                angles: vec![12, 13],
                from: Some(Tick(1000)),
                to: Some(Tick(-1))
            }
        );
        assert_eq!(parse("angles=1%2C2&person=3").unwrap().angles, [1, 2]);
        for (query, field) in [
            ("", "person"),
            ("person=x&angles=1", "person"),
            ("person=1", "angles"),
            ("person=1&angles=1,,2", "angles"),
            ("person=1&angles=1,2,3,4,5,6,7,8,9", "angles"),
            ("person=1&angles=1&from=now", "from"),
            ("person=1&angles=1&by=2", "by"),
        ] {
            assert_eq!(parse(query).unwrap_err().field, field, "{query}");
        }
    }

    proptest! {
        #[test]
        fn any_query_is_one_or_an_error(query in "[a-z0-9=&,%-]{0,80}") {
            let _asked = parse(&query);
        }
    }
}
