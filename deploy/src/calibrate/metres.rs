//! The origin of a calibration's scale (the length of a metre), and what checks it.

use farfield_calibration::alignment::{Anchors, Known, KnownMark};

/// Other sources of the scale than anchors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum OtherScale {
    Nothing,
    /// The mean stature of the people.
    Stature,
    /// The squares of a board that is one rigid body.
    Board {
        square_mm: f64,
    },
}

/// The origin of the scale and what checks it, in sentences. Anchors of cameras in `without_pose` do not count, which
/// is reported.
pub(super) fn metres(anchors: &Anchors, without_pose: &[&str], other: OtherScale) -> String {
    let lost = anchors.lost(|name| !without_pose.contains(&name));
    let lost = lost.map_or_else(String::new, |lost| format!(" Note that {lost}."));
    let sources = sources(&anchors.without(without_pose));
    let text = match (sources.as_slice(), other) {
        ([], OtherScale::Nothing) => {
            "The scale is unknown: give a distance, positions of cameras, or marks.".to_owned()
        }
        ([], OtherScale::Stature) => {
            "The scale comes from the mean stature of the people, with an error of 1 to 2 %, and nothing checks it: measure a distance \
             of 5 m or more."
                .to_owned()
        }
        ([], OtherScale::Board { square_mm }) => format!(
            "The scale comes from the squares of the board, {square_mm:.1} mm, and nothing checks it: measure a distance of 5 m or more."
        ),
        (all, OtherScale::Board { square_mm }) => format!(
            "The scale comes from {}, compared with the squares of the board, {square_mm:.1} mm.",
            all.join(" and ")
        ),
        ([only], _) if only.starts_with("one ") => {
            format!("The scale comes from {only}, and nothing checks it: measure another one.")
        }
        (all, _) => format!(
            "The scale comes from {}, compared with each other.",
            all.join(" and ")
        ),
    };
    if matches!(other, OtherScale::Board { .. }) {
        return text + &lost;
    }
    format!(
        "{text}{lost} Boards determine lenses, not the scale: a wrong size of their squares has no effect on it."
    )
}

/// Counts of the anchors that give the scale, by kind.
fn sources(anchors: &Anchors) -> Vec<String> {
    let counted = |count: usize, one: &str, more: &str| match count {
        0 => None,
        1 => Some(format!("one {one}")),
        count => Some(format!("{count} {more}")),
    };
    let marks = anchors.marks.as_ref();
    let known = marks.map_or(&[][..], |it| &it.known);
    let is_line = |it: &&KnownMark| matches!(it.known, Known::OnLine(_));
    let lines = known.iter().filter(is_line).count();
    // Two camera positions alone give no length; together with marks each position is part of the fit.
    let least = if known.is_empty() { 3 } else { 1 };
    let places = Some(anchors.centers_m.len()).filter(|count| *count >= least);
    let lengths = marks.map_or(0, |it| it.lengths.len());
    let sources = [
        counted(known.len() - lines, "clicked mark", "clicked marks"),
        counted(lines, "clicked line", "clicked lines"),
        counted(
            places.unwrap_or(0),
            "position of a camera",
            "positions of cameras",
        ),
        counted(
            anchors.distances.len(),
            "distance between cameras",
            "distances between cameras",
        ),
        counted(lengths, "clicked length", "clicked lengths"),
    ];
    sources.into_iter().flatten().collect()
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_calibration::alignment::{KnownDistance, Marks};

    use super::*;

    #[test]
    fn the_origin_of_the_scale_and_its_check_are_reported() {
        let metres = |anchors: &Anchors, other| metres(anchors, &[], other);
        let mut anchors = Anchors::default();
        assert!(sources(&anchors).is_empty());
        assert!(metres(&anchors, OtherScale::Nothing).starts_with("The scale is unknown"));
        assert!(metres(&anchors, OtherScale::Stature).contains("stature"));
        anchors.distances.push(KnownDistance {
            first: "a".to_owned(),
            second: "b".to_owned(),
            distance_m: 3.0,
        });
        assert_eq!(sources(&anchors), ["one distance between cameras"]);
        let one = metres(&anchors, OtherScale::Stature);
        assert!(one.contains("nothing checks it"), "{one}");
        let place = |name: &str| (name.to_owned(), [0.0; 3]);
        anchors.centers_m = vec![place("a"), place("b")];
        let same = metres(&anchors, OtherScale::Nothing);
        assert_eq!(same, one, "two positions give no length");
        anchors.centers_m.push(place("c"));
        let both = ["3 positions of cameras", "one distance between cameras"];
        assert_eq!(sources(&anchors), both);
        let text = metres(&anchors, OtherScale::Nothing);
        assert!(text.contains(&both.join(" and ")), "{text}");
        assert!(!text.contains("nothing checks it"), "{text}");
    }

    #[test]
    fn anchors_of_a_camera_without_pose_do_not_count_and_are_named() {
        let place = |name: &str| (name.to_owned(), [0.0; 3]);
        let mut anchors = Anchors {
            centers_m: ["a", "b", "c"].map(place).to_vec(),
            ..Anchors::default()
        };
        let text = metres(&anchors, &["c", "d"], OtherScale::Nothing);
        assert!(text.starts_with("The scale is unknown"), "{text}");
        assert!(text.contains("camera `c`") && !text.contains('3'), "{text}");
        anchors.centers_m.extend(["d", "e"].map(place));
        let text = metres(&anchors, &["c", "d"], OtherScale::Nothing);
        assert!(
            text.contains("3 positions") && text.contains("cameras `c`, `d`"),
            "{text}"
        );
        let all = metres(&anchors, &[], OtherScale::Nothing);
        assert!(all.contains("5 positions") && !all.contains('`'), "{all}");
    }

    #[test]
    fn few_camera_positions_count_with_clicked_marks_and_lines_are_separate() {
        let marks = |clicked: &str| {
            let text = format!("court = \"futsal\"\n[camera.a]\n{clicked}");
            Marks::parse(&text, Path::new("clicked.toml")).ok()
        };
        let centre = "centre = [1, 2]\n";
        let mut anchors = Anchors {
            marks: marks(centre),
            ..Anchors::default()
        };
        assert_eq!(sources(&anchors), ["one clicked mark"]);
        anchors.centers_m = ["a", "b"].map(|name| (name.to_owned(), [0.0; 3])).to_vec();
        assert_eq!(
            sources(&anchors),
            ["one clicked mark", "2 positions of cameras"]
        );
        anchors.centers_m.pop();
        anchors.marks = marks(&format!(
            "{centre}touchline_north = [[1, 2], [3, 4]]\nhalfway_line = [[5, 6]]\n"
        ));
        let all = [
            "one clicked mark",
            "2 clicked lines",
            "one position of a camera",
        ];
        assert_eq!(sources(&anchors), all);
    }
}
