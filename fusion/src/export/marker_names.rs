//! What points are called in files that `OpenSim` reads: TRC files, and the models that go with them.

use std::collections::BTreeSet;

/// What `OpenSim` refuses in names of components, and what would end a cell of a TRC file or a line.
const REFUSED: [char; 4] = ['\\', '/', '*', '+'];
/// Characters that no XML document can hold.
const NOT_IN_XML: [char; 2] = ['\u{fffe}', '\u{ffff}'];

/// `name` as `OpenSim` takes it: each of `\ / * +`, blanks, tabs, line ends and control characters is `_`.
///
/// Source: `OpenSim` 4, `ComponentPath`, whose message is "contains invalid characters of: '\*+ \t\n/'".
pub fn opensim_name(name: &str) -> String {
    let is_refused = |c: char| {
        c.is_whitespace() || c.is_control() || REFUSED.contains(&c) || NOT_IN_XML.contains(&c)
    };
    let safe = |c: char| if is_refused(c) { '_' } else { c };
    name.chars().map(safe).collect()
}

/// What points are called, joints first, each name once. A keypoint that is called like a joint is `keypoint_<name>`; one
/// that is called as another once `OpenSim` can read it has a number.
pub fn point_names(joints: &[String], keypoints: &[String]) -> Vec<String> {
    let mut names = joints.to_vec();
    let mut taken: BTreeSet<String> = joints.iter().cloned().collect();
    for keypoint in keypoints {
        let mut name = opensim_name(keypoint);
        if joints.contains(&name) {
            name = format!("keypoint_{name}");
        }
        let numbered = (2..).map(|number: u64| format!("{name}_{number}"));
        let mut texts = std::iter::once(name.clone()).chain(numbered);
        let free = texts.find(|text| !taken.contains(text)).unwrap_or_default();
        taken.insert(free.clone());
        names.push(free);
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_name_holds_what_opensim_refuses() {
        for (name, expected) in [
            ("left_knee", "left_knee"),
            ("Anna Maria", "Anna_Maria"),
            ("A*/B+C\\D", "A__B_C_D"),
            ("a\tb\nc\rd\u{1b}e", "a_b_c_d_e"),
            ("محمد علي", "محمد_علي"),
            ("<&>\"'1", "<&>\"'1"),
            ("\u{a0}\u{ffff}", "__"),
        ] {
            assert_eq!(opensim_name(name), expected);
        }
    }

    #[test]
    fn names_that_become_equal_are_told_apart() {
        let texts = |names: &[&str]| names.iter().map(|it| (*it).to_owned()).collect::<Vec<_>>();
        let keypoints = ["big toe", "big/toe", "big_toe_2", "left knee", "left_knee"];
        let names = point_names(&texts(&["left_knee"]), &texts(&keypoints));
        let expected = [
            "left_knee",
            "big_toe",
            "big_toe_2",
            "big_toe_2_2",
            "keypoint_left_knee",
            "keypoint_left_knee_2",
        ];
        assert_eq!(names, expected);
    }
}
