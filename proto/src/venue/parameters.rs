//! The tunable parts of the method, one table of the venue file each. Every field has a default,
//! so every table and every field may be left out.

use serde::{Deserialize, Serialize};

use crate::patch::CompressionLevel;

macro_rules! parameters {
    ($(#[$outer:meta])* $name:ident { $($(#[$inner:meta])* $field:ident : $kind:ty = $default:expr,)* }) => {
        $(#[$outer])*
        #[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub struct $name {
            $($(#[$inner])* pub $field: $kind,)*
        }

        impl Default for $name {
            fn default() -> Self {
                Self { $($field: $default,)* }
            }
        }
    };
}

parameters! {
    /// `[lattice]`: the search for the most probable keypoint positions, paper (6)-(8).
    LatticeParameters {
        /// How far from the prediction a keypoint is searched, metres per axis (s k of the paper). Default 0.25.
        half_width_m: f64 = 0.25,
        /// Step of the coarse pass, in map cells of the finest view. Below the width of a peak
        /// (sigma 2 cells), or the search steps over it. Default 2.0.
        coarse_step_cells: f64 = 2.0,
        /// Fine steps per coarse step. Default 4.
        fine_per_coarse: u32 = 4,
        /// Sigma of the Gaussian around the prediction that candidates are weighed by, metres: the other
        /// ankle is inside the lattice. Default 0.20.
        prior_sigma_m: f64 = 0.20,
        /// Weighted mean of the maps below which a keypoint counts as unsupported and falls back to
        /// the prediction with weight 0. Default 0.08.
        min_support: f64 = 0.08,
        /// Angle between two viewpoints' rays, degrees, below which they are not two independent
        /// witnesses. Default 8.
        independent_angle_deg: f64 = 8.0,
    }
}

parameters! {
    /// `[occlusion]`: what a map is worth while another body stands in front, paper (9).
    OcclusionParameters {
        /// The weight g of an occluded view, 0 to 1. Default 0.4.
        weight: f64 = 0.4,
        /// Radius of limbs, metres. Default 0.07.
        limb_radius_m: f64 = 0.07,
        /// Radius of the trunk, metres. Default 0.14.
        trunk_radius_m: f64 = 0.14,
        /// Radius of the head, metres. Default 0.11.
        head_radius_m: f64 = 0.11,
    }
}

parameters! {
    /// `[contact]`: persons who meet, and sides that are taken for one another.
    ContactParameters {
        /// Share of a peak that a person loses when it is another's beyond doubt, 0 to 1; 0: peaks are
        /// not shared out. Default 0.8.
        yield_share: f64 = 0.8,
        /// Expected error of the prediction of a keypoint that two viewpoints showed at the last tick,
        /// metres. Default 0.06.
        seen_sigma_m: f64 = 0.06,
        /// The same for one that they did not show. Default 0.12.
        unseen_sigma_m: f64 = 0.12,
        /// How much higher, 0 to 1, both maps of a left and a right must be crosswise than straight for
        /// the view to have exchanged them; above 1: exchanges are not undone. Default 0.25.
        exchange_margin: f64 = 0.25,
        /// What it costs that limbs of two persons reach into each other, as a share of a fully
        /// supported keypoint's weight; 0: they may. Default 0.01.
        separation_weight: f64 = 0.01,
        /// How thick bodies are that keep apart, as a share of the radii of `[occlusion]`. Default 0.6.
        body_share: f64 = 0.6,
    }
}

parameters! {
    /// `[ik]`: both inverse kinematics, paper (10)-(12) and (14)-(15).
    IkParameters {
        /// Most Gauss-Newton iterations of one solve. Default 10.
        iterations: u32 = 10,
        /// A solve ends when no joint angle moves by more, radians. Default 1e-4.
        tolerance_rad: f64 = 1e-4,
        /// Expected error of a fully supported keypoint, metres. Default 0.02.
        keypoint_sigma_m: f64 = 0.02,
        /// Least weight of a supported keypoint (floor of W in (12)). Default 0.05.
        min_weight: f64 = 0.05,
        /// Sigma of the rest-pose prior on DoF that keypoints do not determine, radians. Default 0.35.
        rest_sigma_rad: f64 = 0.35,
        /// Sigma of the change of a joint angle from the last tick, radians at 60 Hz. Default 0.25.
        change_sigma_rad: f64 = 0.25,
        /// Weight of the prediction where no view supports a keypoint, as a share of a fully supported
        /// one's: enough to carry a limb on, never enough to hold against evidence. Default 0.003.
        prediction_weight: f64 = 0.003,
        /// Expected error of a smoothed joint as a target of the second IK, metres. Default 0.003.
        joint_sigma_m: f64 = 0.003,
    }
}

parameters! {
    /// `[smoothing]`: the low-pass filter on the innovation, paper (13).
    SmoothingParameters {
        /// Closed-loop -3 dB frequency for a joint at rest, hertz. Default 1.5.
        cutoff_hz: f64 = 1.5,
        /// How much the cutoff rises with the filtered innovation, hertz per metre: fast motion is
        /// not held back. Default 1000.
        cutoff_rise_hz_per_m: f64 = 1000.0,
        /// How much the cutoff rises with the joint's speed, hertz per metre per second: what moves fast
        /// is not held back, what stands stays. Default 4.
        cutoff_rise_per_m: f64 = 4.0,
        /// Cutoff of the low-pass that the innovation goes through before it raises the cutoff, hertz.
        /// High enough to notice the start of a kick within two or three ticks, low enough that the
        /// noise of single ticks averages out. Default 4.
        innovation_cutoff_hz: f64 = 4.0,
        /// Time constant of the velocity's decay while nothing is measured, seconds: limbs that coast
        /// at full speed leave the body within half a second. Default 0.25.
        coast_decay_s: f64 = 0.25,
        /// Delay of a second output that is smoothed with what came after it, milliseconds; 0: there is
        /// none. Default 0.
        delay_ms: f64 = 0.0,
    }
}

/// How the next pose is predicted, paper (3).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Predictor {
    /// The paper's formula, 3/2 P(t) - P(t-1) + 1/2 P(t-2); no motion at constant velocity.
    Paper,
    /// The filter's position and velocity, the velocity damped per tick.
    #[default]
    DampedVelocity,
    /// True constant acceleration, 3 P(t) - 3 P(t-1) + P(t-2).
    ConstantAcceleration,
}

parameters! {
    /// `[prediction]`: where persons will be.
    PredictionParameters {
        /// The formula. Default `damped-velocity`.
        predictor: Predictor = Predictor::default(),
        /// Time constant of the decay of what joints move by beside the body as a whole, seconds. Default 0.25.
        velocity_decay_s: f64 = 0.25,
        /// Time constant of the decay of the body's velocity, the mean of its joints', seconds: a limb turns
        /// back soon, who runs goes on. Default 1.0.
        body_velocity_decay_s: f64 = 1.0,
    }
}

parameters! {
    /// `[range_of_motion]`: the hard bounds of the second IK, paper (14).
    RangeOfMotionParameters {
        /// Whether the bounds hold. Default true.
        enabled: bool = true,
        /// Factor on the clinical ranges, for athletes. Default 1.0.
        factor: f64 = 1.0,
    }
}

/// Which camera of a viewpoint looks at a person, paper (5).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum CameraChoice {
    /// The one that sees most of the person, then with the most pixels, then nearest its centre; kept
    /// until another is clearly better.
    #[default]
    BestView,
    /// The paper's: the one whose image centre is nearest to the projected torso, in pixels,
    /// whatever it sees. For comparisons.
    NearestCenter,
}

parameters! {
    /// `[boxes]`: the predicted image regions, paper (2) and (4).
    BoxParameters {
        /// The margin m around the projected joints. Default: the network card's `box_margin`, else 1.25.
        margin: Option<f64> = None,
        /// Whether boxes turn with the body. Default true.
        rotate: bool = true,
        /// Tilt of the trunk from which a box turns, degrees. Default 40.
        rotate_from_deg: f64 = 40.0,
        /// Tilt below which a turned box is upright again, degrees (hysteresis). Default 30.
        rotate_until_deg: f64 = 30.0,
        /// A trunk that is seen shorter than this share of its length is seen end-on, and the box
        /// stays upright. Default 0.5.
        end_on_ratio: f64 = 0.5,
        /// How much people speed up or turn while a box is on its way, metres per second squared: boxes
        /// hold where they may be by then. Default 3.
        acceleration_m_s2: f64 = 3.0,
        /// Which camera of a viewpoint looks at a person. Default `best-view`.
        camera_choice: CameraChoice = CameraChoice::default(),
    }
}

parameters! {
    /// `[births]`: how people are found, kept and let go.
    BirthParameters {
        /// Time between two looks for people without boxes, seconds. Default 1.
        sight_every_s: f64 = 1.0,
        /// Most tiles that the detector looks at beside the whole picture, per camera and look, where
        /// people are too small in it; if more are needed, parts of the field take turns; 0: none. Default 8.
        tiles_per_look: u32 = 8,
        /// Largest distance between the rays of one keypoint from two viewpoints, metres. Default 0.12.
        ray_distance_m: f64 = 0.12,
        /// Least score of a sighted keypoint that counts. Default 0.3.
        min_score: f64 = 0.3,
        /// Least keypoints that two sightings must agree on. Default 6.
        min_keypoints: u32 = 6,
        /// Ticks with evidence from two viewpoints until a person is confirmed. Default 12.
        confirm_ticks: u32 = 12,
        /// How long a tentative person may lack evidence, seconds. Default 0.2.
        tentative_s: f64 = 0.2,
        /// How long a person is carried by the model alone, seconds. Default 1.
        coast_s: f64 = 1.0,
        /// How long a person is carried on while a single viewpoint sees it, seconds. Default 5.
        one_view_s: f64 = 5.0,
        /// For how long a person who is gone can come back under its id, seconds; 0: never (whoever is still
        /// carried on is found again in any case). Default 60.
        return_s: f64 = 60.0,
        /// Fastest that a person who is not seen can have moved, metres per second. Default 8.
        return_speed_m_s: f64 = 8.0,
        /// Keypoints that lie within this of one plane, root mean square, each by its expected error over
        /// the average one's, may be those of a picture, metres. Default 0.04.
        flat_m: f64 = 0.04,
        /// How far a flat body's keypoints must move to be a person's, the median of them, metres. Default 0.06.
        moved_m: f64 = 0.06,
        /// How long a flat body that does not move stays tentative until it is taken for a picture,
        /// seconds; the finished ticks of all are held back until it is decided. Default 5.
        still_s: f64 = 5.0,
        /// A sighting within this distance of a tracked person is explained by it, metres. Default 0.35.
        explained_m: f64 = 0.35,
        /// Ticks in a row in which the edges look again when a sighting is explained by nobody. Default 5.
        look_again_ticks: u32 = 5,
        /// Most of its ticks in which a camera looks for people, as a share, 0 to 1: what fusion asks for
        /// beside the regular looks waits when there was more. The bound over any n ticks is this share
        /// of n, `look_again_ticks`, and the regular looks. Default 0.25.
        look_share: f64 = 0.25,
        /// Least keypoints with evidence from two viewpoints for a person to count as seen. Default 4.
        min_seen_keypoints: u32 = 4,
        /// Until when a person's link lengths are measured anew, 2, 4, 8, ... seconds after its birth,
        /// seconds; 0: those of the birth stay. Default 16.
        measure_s: f64 = 16.0,
        /// Two persons whose joints are closer than this on average stand in one place, metres. Default 0.15.
        same_place_m: f64 = 0.15,
        /// For how long two persons may stand in one place until one of them is taken for a ghost,
        /// seconds. Default 0.25.
        same_place_s: f64 = 0.25,
        /// How far outside the field a person is let go, metres. Default 1.
        outside_field_m: f64 = 1.0,
    }
}

impl BirthParameters {
    /// Ticks from one regular look to the next, at least 1: all viewpoints look at the ticks that this divides.
    pub fn ticks_per_look(&self, rate_hz: f64) -> i64 {
        (self.sight_every_s * rate_hz).round().max(1.0) as i64
    }
}

parameters! {
    /// `[link]`: bytes and delays.
    LinkParameters {
        /// How closely maps are kept on the wire, a name or a level. Default: `lossless` in lock-step,
        /// `default` live, where the link may lower it.
        quality: Option<CompressionLevel> = None,
        /// Longest wait for a node in lock-step before the run fails, seconds. Default 60.
        lockstep_timeout_s: f64 = 60.0,
        /// Most that an edge hands to the network in any second, with what the protocols below add to each
        /// message, bytes; 0: no bound but what its link carries. Default 0.
        budget_bytes_per_s: f64 = 0.0,
        /// Live: longest after a tick that fusion waits for its patches, milliseconds. It waits no longer than
        /// links really take. Default 400.
        deadline_ms: f64 = 400.0,
        /// Live: an edge whose clock is surely off by more is refused, milliseconds. Default 100.
        clock_bound_ms: f64 = 100.0,
    }
}

parameters! {
    /// `[recording]`: what is kept of a run, and what edges keep for it.
    RecordingParameters {
        /// Length of a chunk, seconds: what a recording loses at most when its process is killed. Default 1.
        chunk_s: f64 = 1.0,
        /// Whether poses are recorded as JSON too, for other programs to read: about 3 kB per person and
        /// tick. Default true.
        json_poses: bool = true,
        /// Recordings in the same folder that are older are deleted, days; 0: none. Default 0.
        retention_days: f64 = 0.0,
        /// What an edge keeps on disk of what it sent or could not send when it runs live, MiB; 0:
        /// nothing. Default 32.
        ring_mib: u32 = 32,
        /// Share of a link's budget that fusion may use to get what an outage has kept from it, 0 to 1;
        /// 0: holes stay. Default 0.1.
        fill_share: f64 = 0.1,
    }
}

/// All tables of parameters.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Parameters {
    /// `[lattice]`
    pub lattice: LatticeParameters,
    /// `[occlusion]`
    pub occlusion: OcclusionParameters,
    /// `[contact]`
    pub contact: ContactParameters,
    /// `[ik]`
    pub ik: IkParameters,
    /// `[smoothing]`
    pub smoothing: SmoothingParameters,
    /// `[prediction]`
    pub prediction: PredictionParameters,
    /// `[range_of_motion]`
    pub range_of_motion: RangeOfMotionParameters,
    /// `[boxes]`
    pub boxes: BoxParameters,
    /// `[births]`
    pub births: BirthParameters,
    /// `[link]`
    pub link: LinkParameters,
    /// `[recording]`
    pub recording: RecordingParameters,
}
