//! Summary of a recording: the scene, and how far its people exceed the range of motion.

use std::fmt::{self, Write as _};

use farfield_sim::scene::range_of_motion::{
    AngleExcess, PersonExcess, RangeOfMotionExcess, TOLERANCE_DEG, range_of_motion_excess,
};

use super::RecordingPlan;

/// Most angles listed for a person.
const MOST_ANGLES: usize = 3;

/// The scene and the folder of its recording.
pub(super) fn text(plan: &RecordingPlan) -> String {
    let mut text = String::new();
    // Writing to a String cannot fail.
    let _infallible = write_scene(&mut text, plan);
    text
}

fn write_scene(text: &mut String, plan: &RecordingPlan) -> fmt::Result {
    let scene = &plan.scene;
    writeln!(
        text,
        "{}: {} people, {} cameras in {} viewpoints, ticks {}..{} at {} Hz",
        plan.from,
        scene.people().len(),
        scene.cameras().len(),
        scene.viewpoints().len(),
        plan.ticks.start,
        plan.ticks.end,
        scene.rate_hz()
    )?;
    write_excess(text, &range_of_motion_excess(scene))?;
    let venue = plan.out.join("venue.toml");
    writeln!(
        text,
        "recorded in {}; run it with `farfield run {}`",
        plan.out.display(),
        venue.display()
    )
}

fn write_excess(text: &mut String, excess: &RangeOfMotionExcess) -> fmt::Result {
    let (samples, outside) = excess.total();
    let but_feet = excess.people.iter().map(|p| p.outside_but_feet).sum();
    writeln!(
        text,
        "outside the clinical range of motion by more than {TOLERANCE_DEG} degrees: {} of the time \
         ({} without ankles and feet)",
        percent(outside, samples),
        percent(but_feet, samples)
    )?;
    for person in excess.people.iter().filter(|person| person.outside > 0) {
        writeln!(
            text,
            "  person {}: {} of the time{}",
            person.person,
            percent(person.outside, person.samples),
            worst(person)
        )?;
    }
    Ok(())
}

fn worst(person: &PersonExcess) -> String {
    let angle = |angle: &AngleExcess| {
        format!(
            ", {} {} (up to {:.0} degrees)",
            angle.name,
            percent(angle.outside, person.samples),
            angle.most_deg
        )
    };
    person.angles.iter().take(MOST_ANGLES).map(angle).collect()
}

fn percent(part: usize, whole: usize) -> String {
    format!("{:.0} %", 100.0 * part as f64 / whole.max(1) as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn people_outside_the_range_are_listed_with_their_worst_angles() {
        let angle = AngleExcess {
            name: "knee_angle_l".to_owned(),
            outside: 5,
            most_deg: 12.4,
        };
        let person = PersonExcess {
            person: 2,
            samples: 20,
            outside: 10,
            outside_but_feet: 4,
            angles: vec![angle],
        };
        let mut text = String::new();
        write_excess(
            &mut text,
            &RangeOfMotionExcess {
                people: vec![person],
            },
        )
        .unwrap();
        assert_eq!(
            text,
            "outside the clinical range of motion by more than 3 degrees: 50 % of the time (20 % without \
             ankles and feet)\n  \
             person 2: 50 % of the time, knee_angle_l 25 % (up to 12 degrees)\n"
        );
    }
}
