//! The venue file of a scene: its viewpoints and cameras, with sources of any kind.

use std::fmt::Write as _;
use std::ops::Range;

use farfield_proto::camera::CameraModel;
use farfield_proto::keypoints::COCO17;
use farfield_proto::tick::Tick;
use nalgebra::Vector3;

use crate::scene::Scene;

/// The content of `venue.toml` in addition to the scene. Paths are relative to the venue's folder.
pub struct VenueText<'a> {
    /// The scene.
    pub scene: &'a Scene,
    /// Name of the venue: letters, digits, `-`, `_` and `.`.
    pub name: &'a str,
    /// Comment lines at the start of the file.
    pub head: &'a str,
    /// The calibration file.
    pub calibration: &'a str,
    /// The network's card; required if sources give pictures.
    pub network: Option<&'a str>,
    /// The detector's card.
    pub detector: Option<&'a str>,
    /// The `source` of a camera, as an inline table.
    pub source: &'a dyn Fn(&CameraModel) -> String,
    /// Tick of the first frame of recorded sources.
    pub first_tick: Tick,
    /// The people are given by hand at the first of these ticks at which they are present, for
    /// sources without sightings. `None`: people are detected.
    pub given: Option<Range<Tick>>,
}

impl VenueText<'_> {
    /// The text of the file.
    pub fn to_toml(&self) -> String {
        let mut text = String::new();
        // Writing to a String cannot fail.
        let _infallible = self.write(&mut text);
        text
    }

    fn write(&self, text: &mut String) -> std::fmt::Result {
        for line in self.head.lines() {
            writeln!(text, "# {line}")?;
        }
        writeln!(text, "name = {}", quoted(self.name))?;
        writeln!(text, "rate_hz = {:?}", self.scene.rate_hz())?;
        writeln!(text, "first_tick = {}", self.first_tick)?;
        writeln!(text, "calibration = {}", quoted(self.calibration))?;
        for (field, card) in [("network", self.network), ("detector", self.detector)] {
            if let Some(card) = card {
                writeln!(text, "{field} = {}", quoted(card))?;
            }
        }
        let [min_m, max_m] = self.scene.field_bounds_m();
        writeln!(text, "\n[field]\nmin_m = {min_m:?}\nmax_m = {max_m:?}")?;
        if self.scene.floor_m() != 0.0 {
            writeln!(text, "floor_m = {:?}", self.scene.floor_m())?;
        }
        for viewpoint in self.scene.viewpoints() {
            writeln!(text, "\n[[viewpoint]]\nname = {}", quoted(&viewpoint.name))?;
            for &camera in &viewpoint.cameras {
                let model = &self.scene.cameras()[camera];
                writeln!(
                    text,
                    "[[viewpoint.camera]]\nname = {}",
                    quoted(model.name())
                )?;
                writeln!(text, "source = {}", (self.source)(model))?;
            }
        }
        match &self.given {
            Some(ticks) => self.write_given(text, ticks),
            None => Ok(()),
        }
    }

    fn write_given(&self, text: &mut String, ticks: &Range<Tick>) -> std::fmt::Result {
        for person in 0..self.scene.people().len() {
            let Some((tick, sites_m)) = first_seen(self.scene, person, ticks) else {
                continue;
            };
            writeln!(text, "\n[[person]]\ntick = {tick}\n[person.keypoints_m]")?;
            for (name, site) in COCO17.iter().zip(sites_m) {
                writeln!(
                    text,
                    "{name} = [{:.4}, {:.4}, {:.4}]",
                    site.x, site.y, site.z
                )?;
            }
        }
        Ok(())
    }
}

/// The first of `ticks` at which a person is inside the field, and the keypoint sites at that time:
/// world, metres, in COCO's order.
fn first_seen(
    scene: &Scene,
    person: usize,
    ticks: &Range<Tick>,
) -> Option<(Tick, [Vector3<f64>; 17])> {
    let [min_m, max_m] = scene.field_bounds_m();
    let is_inside = |site: &Vector3<f64>| (0..3).all(|i| (min_m[i]..=max_m[i]).contains(&site[i]));
    (ticks.start.0..ticks.end.0).map(Tick).find_map(|tick| {
        let truth = scene.truth_at(person, tick)?;
        let is_there = truth.sites_m.iter().all(is_inside);
        is_there.then_some((tick, truth.sites_m))
    })
}

/// `text` as a TOML string.
pub fn quoted(text: &str) -> String {
    toml::Value::from(text).to_string()
}
