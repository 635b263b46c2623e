//! Names of points in files for `OpenSim`: TRC files, and the models that belong to them.

use std::collections::BTreeSet;

/// Characters that `OpenSim` refuses in names of components, or that would end a cell or line of a
/// TRC file.
const REFUSED: [char; 4] = ['\\', '/', '*', '+'];
/// Characters that XML does not allow.
const NOT_IN_XML: [char; 2] = ['\u{fffe}', '\u{ffff}'];

/// `name` in a form that `OpenSim` accepts: each of `\ / * +`, blanks, tabs, line ends and control
/// characters is `_`.
///
/// Source: `OpenSim` 4, `ComponentPath`, whose message is "contains invalid characters of: '\*+ \t\n/'".
pub fn opensim_name(name: &str) -> String {
    let is_refused = |c: char| {
        c.is_whitespace() || c.is_control() || REFUSED.contains(&c) || NOT_IN_XML.contains(&c)
    };
    let safe = |c: char| if is_refused(c) { '_' } else { c };
    name.chars().map(safe).collect()
}

/// Unique names of points, joints first. A keypoint with the name of a joint is `keypoint_<name>`;
/// a name that is no longer unique in `OpenSim`'s form gets a number.
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
    fn no_name_has_characters_that_opensim_refuses() {
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
    fn names_that_become_equal_get_numbers() {
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
