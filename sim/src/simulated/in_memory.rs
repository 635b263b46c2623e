//! The venue of a scene in memory: what `farfield simulate` would write, without files.

use std::collections::BTreeMap;
use std::ops::Range;
use std::path::PathBuf;
use std::sync::Arc;

use farfield_edge::source::{FrameSource, SourceError};
use farfield_proto::id::{CameraIndex, ViewpointIndex};
use farfield_proto::keypoints::{COCO17, KeypointSet};
use farfield_proto::tick::Tick;
use farfield_proto::venue::{
    Endpoints, Field, GivenPerson, Parameters, Security, SimulatedContent, Source, TickFrom, Venue,
    VenueCamera, VenueHash, Viewpoint,
};

use super::SimulatedSource;
use crate::faults::SceneCrowd;
use crate::scene::Scene;

/// Cells of the maps made without pixels: width, height.
const GRID: [u16; 2] = [48, 64];
/// Sigma of their peaks, cells.
const SIGMA_CELLS: f64 = 2.0;

/// The output of a scene's cameras.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Input {
    /// Maps made from the truth with the scene's faults. People are detected automatically.
    Maps,
    /// Rendered pictures for the network of this card.
    Pixels {
        /// The network's card.
        network: PathBuf,
        /// The card of the detector. Without it, people are given by hand at their entry.
        detector: Option<PathBuf>,
    },
}

impl Input {
    fn content(&self) -> SimulatedContent {
        match self {
            Self::Maps => SimulatedContent::Maps,
            Self::Pixels { .. } => SimulatedContent::Pixels,
        }
    }
}

/// The venue of `scene` over all its ticks.
pub fn venue_of(scene: &Scene, input: &Input, parameters: Parameters) -> Venue {
    let mut viewpoints = Vec::new();
    let mut cameras = Vec::new();
    for (index, viewpoint) in scene.viewpoints().iter().enumerate() {
        let of_scene = viewpoint.cameras.iter().map(|&camera| VenueCamera {
            viewpoint: ViewpointIndex(index as u16),
            model: scene.cameras()[camera].clone(),
            source: Source::Simulated {
                path: PathBuf::new(),
                content: input.content(),
                grid: GRID,
                sigma_cells: SIGMA_CELLS,
            },
            tick_from: TickFrom::Clock,
            capture_delay_s: None,
        });
        let first = cameras.len();
        cameras.extend(of_scene);
        let own = (first..cameras.len()).map(|camera| CameraIndex(camera as u16));
        viewpoints.push(Viewpoint {
            name: viewpoint.name.clone(),
            cameras: own.collect(),
            providers: Vec::new(),
        });
    }
    let [min_m, max_m] = scene.field_bounds_m();
    let (network, detector) = match input {
        Input::Maps => (None, None),
        Input::Pixels { network, detector } => (Some(network.clone()), detector.clone()),
    };
    let is_given = network.is_some() && detector.is_none();
    let given_persons = if is_given { given(scene) } else { Vec::new() };
    Venue {
        name: "scene".to_owned(),
        rate_hz: scene.rate_hz(),
        first_tick: Tick(0),
        calibration_path: PathBuf::new(),
        network,
        detector,
        keypoints: KeypointSet::coco17(),
        endpoints: Endpoints::default(),
        security: Security::default(),
        field: Field {
            min_m,
            max_m,
            floor_m: scene.floor_m(),
        },
        court: None,
        viewpoints,
        cameras,
        given_persons,
        streams: Vec::new(),
        subjects: Vec::new(),
        parameters,
        hashes: VenueHash {
            venue: String::new(),
            calibration: String::new(),
        },
    }
}

/// The frames of every camera of [`venue_of`]'s venue, in its order.
///
/// Pictures have none of the faults of maps. For [`Input::Pixels`] the scene must come from
/// [`super::without_map_faults`]; otherwise its truth has sites that no picture shows.
///
/// # Errors
/// When no thread can be started for rendering.
pub fn sources_of(
    scene: &Arc<Scene>,
    input: &Input,
) -> Result<Vec<Box<dyn FrameSource>>, SourceError> {
    let crowd = Arc::new(SceneCrowd::new(Arc::clone(scene)));
    let cameras = scene.viewpoints().iter().flat_map(|v| &v.cameras);
    cameras
        .map(|&camera| {
            let ticks = scene.ticks();
            let source = SimulatedSource::new(&crowd, camera, input.content(), ticks, Tick(0))?;
            Ok(Box::new(source) as Box<dyn FrameSource>)
        })
        .collect()
}

/// All people at the first tick at which they are inside the field.
fn given(scene: &Scene) -> Vec<GivenPerson> {
    let [min_m, max_m] = scene.field_bounds_m();
    let Range { start, end } = scene.ticks();
    let of_person = |person: usize| {
        (start.0..end.0).map(Tick).find_map(|tick| {
            let truth = scene.truth_at(person, tick)?;
            let inside = |i: usize| {
                let site = &truth.sites_m[i];
                (0..2).all(|axis| (min_m[axis]..=max_m[axis]).contains(&site[axis]))
            };
            (0..COCO17.len()).all(inside).then(|| GivenPerson {
                tick,
                keypoints_m: COCO17
                    .iter()
                    .zip(&truth.sites_m)
                    .map(|(name, site)| ((*name).to_owned(), [site.x, site.y, site.z]))
                    .collect::<BTreeMap<_, _>>(),
            })
        })
    };
    (0..scene.people().len()).filter_map(of_person).collect()
}
