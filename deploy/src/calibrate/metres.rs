//! How long a metre is in a calibration: who said so, and what checks it.

use farfield_calibration::alignment::{Anchors, Known, KnownMark};

/// What else says how long a metre is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Otherwise {
    /// Nothing.
    Nothing,
    /// The people's mean stature.
    Stature,
    /// The squares of a board that is one body.
    Board { square_mm: f64 },
}

/// Where metres come from and what checks them, in sentences. What is known of the cameras `without_pose` tells nothing, and
/// that is said.
pub(super) fn metres(anchors: &Anchors, without_pose: &[&str], otherwise: Otherwise) -> String {
    let lost = anchors.lost(|name| !without_pose.contains(&name));
    let lost = lost.map_or_else(String::new, |lost| format!(" Note that {lost}."));
    let anchors = &anchors.without(without_pose);
    let counted = |count: usize, one: &str, more: &str| match count {
        0 => None,
        1 => Some(format!("one {one}")),
        count => Some(format!("{count} {more}")),
    };
    let marks = anchors.marks.as_ref();
    let known = marks.map_or(&[][..], |it| &it.known);
    let is_line = |it: &&KnownMark| matches!(it.known, Known::OnLine(_));
    let lines = known.iter().filter(is_line).count();
    // Alone two places of cameras tell no length; beside marks each of them is fitted with these.
    let least = if known.is_empty() { 3 } else { 1 };
    let places = Some(anchors.centers_m.len()).filter(|count| *count >= least);
    let lengths = marks.map_or(0, |it| it.lengths.len());
    let sources = [
        counted(known.len() - lines, "clicked mark", "clicked marks"),
        counted(lines, "clicked line", "clicked lines"),
        counted(
            places.unwrap_or(0),
            "place of a camera",
            "places of cameras",
        ),
        counted(
            anchors.distances.len(),
            "distance between cameras",
            "distances between cameras",
        ),
        counted(lengths, "clicked length", "clicked lengths"),
    ];
    let sources: Vec<String> = sources.into_iter().flatten().collect();
    let said = match (sources.as_slice(), otherwise) {
        ([], Otherwise::Nothing) => {
            "Nothing says how long a metre is: give a distance, places of cameras, or marks.".to_owned()
        }
        ([], Otherwise::Stature) => {
            "Metres come from the mean stature of the people, which is good to 1 to 2 %, and nothing checks them: measure a distance \
             of 5 m or more."
                .to_owned()
        }
        ([], Otherwise::Board { square_mm }) => format!(
            "Metres come from the squares of the board, {square_mm:.1} mm, and nothing checks them: measure a distance of 5 m or more."
        ),
        (all, Otherwise::Board { square_mm }) => format!(
            "Metres come from {}, which are held against the squares of the board, {square_mm:.1} mm.",
            all.join(" and ")
        ),
        ([only], _) if only.starts_with("one ") => {
            format!("Metres come from {only}, and nothing checks it: measure another one.")
        }
        (all, _) => format!(
            "Metres come from {}, which are held against each other.",
            all.join(" and ")
        ),
    };
    if matches!(otherwise, Otherwise::Board { .. }) {
        return said + &lost;
    }
    format!(
        "{said}{lost} Boards tell lenses and no metres: a wrong size of their squares changes nothing here."
    )
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use farfield_calibration::alignment::{KnownDistance, Marks};

    use super::*;

    #[test]
    fn what_says_metres_and_what_checks_them_is_told() {
        let metres = |anchors: &Anchors, otherwise| metres(anchors, &[], otherwise);
        let mut anchors = Anchors::default();
        assert!(metres(&anchors, Otherwise::Nothing).starts_with("Nothing says"));
        assert!(metres(&anchors, Otherwise::Stature).contains("stature"));
        anchors.distances.push(KnownDistance {
            first: "a".to_owned(),
            second: "b".to_owned(),
            distance_m: 3.0,
        });
        let said = metres(&anchors, Otherwise::Stature);
        assert!(
            said.contains("from one distance between cameras, and nothing checks it"),
            "{said}"
        );
        let place = |name: &str| (name.to_owned(), [0.0; 3]);
        anchors.centers_m = vec![place("a"), place("b")];
        assert_eq!(
            metres(&anchors, Otherwise::Nothing),
            said,
            "two places tell no length"
        );
        anchors.centers_m.push(place("c"));
        let said = metres(&anchors, Otherwise::Nothing);
        let both = "from 3 places of cameras and one distance between cameras, which are held";
        assert!(said.contains(both), "{said}");
    }

    #[test]
    fn what_is_known_of_a_camera_that_did_not_join_does_not_count_and_is_named() {
        let place = |name: &str| (name.to_owned(), [0.0; 3]);
        let mut anchors = Anchors {
            centers_m: ["a", "b", "c"].map(place).to_vec(),
            ..Anchors::default()
        };
        let said = metres(&anchors, &["c", "d"], Otherwise::Nothing);
        assert!(
            said.starts_with("Nothing says how long a metre is"),
            "{said}"
        );
        let lost =
            "Note that what is known of camera `c` does not count, as it did not join the others";
        assert!(said.contains(lost) && !said.contains('3'), "{said}");
        anchors.centers_m.extend(["d", "e"].map(place));
        let said = metres(&anchors, &["c", "d"], Otherwise::Nothing);
        assert!(
            said.contains("from 3 places of cameras, which are held"),
            "{said}"
        );
        assert!(said.contains("cameras `c`, `d` does not count"), "{said}");
        let all = metres(&anchors, &[], Otherwise::Nothing);
        assert!(all.contains("5 places") && !all.contains("count"), "{all}");
    }

    #[test]
    fn places_of_cameras_count_beside_clicked_marks_however_few_and_lines_count_apart() {
        let metres = |anchors: &Anchors, otherwise| metres(anchors, &[], otherwise);
        let marks = |clicked: &str| {
            let text = format!("court = \"futsal\"\n[camera.a]\n{clicked}");
            Marks::parse(&text, Path::new("clicked.toml")).ok()
        };
        let centre = "centre = [1, 2]\n";
        let mut anchors = Anchors {
            marks: marks(centre),
            ..Anchors::default()
        };
        let said = metres(&anchors, Otherwise::Nothing);
        let alone = "from one clicked mark, and nothing checks it";
        assert!(said.contains(alone), "{said}");
        anchors.centers_m = ["a", "b"].map(|name| (name.to_owned(), [0.0; 3])).to_vec();
        let said = metres(&anchors, Otherwise::Nothing);
        let both = "from one clicked mark and 2 places of cameras, which are held";
        assert!(said.contains(both), "{said}");
        anchors.centers_m.pop();
        anchors.marks = marks(&format!(
            "{centre}touchline_north = [[1, 2], [3, 4]]\nhalfway_line = [[5, 6]]\n"
        ));
        let said = metres(&anchors, Otherwise::Nothing);
        let all = "from one clicked mark and 2 clicked lines and one place of a camera, which";
        assert!(said.contains(all), "{said}");
    }
}
