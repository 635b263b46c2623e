//! Every parameter: its table, its name, its type, its default, its unit and range, and what it is. Nothing
//! about a parameter is said anywhere else.
//!
//! `user`: what somebody at a venue chooses; it stands in the venue file's table of this name. `tuning`: a
//! number of the method; it stands under `[tuning]`.

use super::choices::{CameraChoice, Predictor};
use super::declare::declare_parameters;
use crate::patch::CompressionLevel;

declare_parameters! {
    /// The search for the most probable keypoint positions, paper (6)-(8).
    lattice: LatticeParameters {
        tuning LatticeTuning {
            /// How far from the prediction a keypoint is searched along each axis (s k of the paper).
            half_width_m: f64 = 0.25, "m", 0.01 to 2.0;
            /// Step of the coarse pass, in map cells of the finest view: below the width of a peak (sigma 2
            /// cells), or the search steps over it.
            coarse_step_cells: f64 = 2.0, "cells", 0.1 to 16.0;
            /// Fine steps per coarse step.
            fine_per_coarse: u32 = 4, "", 1.0 to 32.0;
            /// Sigma of the Gaussian around the prediction that candidates are weighed by: the other ankle is
            /// inside the lattice.
            prior_sigma_m: f64 = 0.20, "m", 0.005 to 10.0;
            /// How wrong the velocity of a limb may be: times the time since the person was last measured (up to 0.25 s and a
            /// tick) it is the sigma, where that is more than `prior_sigma_m`.
            prior_speed_m_s: f64 = 6.0, "m/s", 0.0 to 100.0;
            /// Weighted mean of the maps below which a keypoint counts as unsupported and falls back to the
            /// prediction with weight 0.
            min_support: f64 = 0.08, "", 0.0 to 1.0;
            /// Angle between two viewpoints' rays below which they are not two independent witnesses.
            independent_angle_deg: f64 = 8.0, "deg", 0.0 to 90.0;
        }
    }

    /// What a map is worth while another body stands in front, paper (9).
    occlusion: OcclusionParameters {
        tuning OcclusionTuning {
            /// The weight g of an occluded view.
            weight: f64 = 0.4, "", 0.0 to 1.0;
            /// Radius of limbs.
            limb_radius_m: f64 = 0.07, "m", 0.0 to 1.0;
            /// Radius of the trunk.
            trunk_radius_m: f64 = 0.14, "m", 0.0 to 1.0;
            /// Radius of the head.
            head_radius_m: f64 = 0.11, "m", 0.0 to 1.0;
        }
    }

    /// Persons who meet, and sides that are taken for one another.
    contact: ContactParameters {
        tuning ContactTuning {
            /// Share of a peak that a person loses when it is another's beyond doubt; 0: peaks are not shared
            /// out.
            yield_share: f64 = 0.8, "", 0.0 to 1.0;
            /// Expected error of the prediction of a keypoint that two viewpoints showed at the last tick.
            seen_sigma_m: f64 = 0.06, "m", 1e-3 to 10.0;
            /// Expected error of the prediction of a keypoint that two viewpoints did not show at the last tick.
            unseen_sigma_m: f64 = 0.12, "m", 1e-3 to 10.0;
            /// How much higher both maps of a left and a right must be crosswise than straight for the view to
            /// have swapped them; above 1: left-right swaps are not undone.
            exchange_margin: f64 = 0.25, "", 1e-3 to 2.0;
            /// What it costs that limbs of two persons reach into each other, as a share of a fully supported
            /// keypoint's weight; 0: they may.
            separation_weight: f64 = 0.01, "", 0.0 to 100.0;
            /// How thick bodies are that keep apart, as a share of the radii of `occlusion`.
            body_share: f64 = 0.6, "", 0.0 to 2.0;
        }
    }

    /// Both inverse kinematics, paper (10)-(12) and (14)-(15).
    ik: IkParameters {
        tuning IkTuning {
            /// Most Gauss-Newton iterations of one solve.
            iterations: u32 = 10, "", 1.0 to 1000.0;
            /// A solve ends when no joint angle moves by more.
            tolerance_rad: f64 = 1e-4, "rad", 1e-12 to 0.1;
            /// Expected error of a fully supported keypoint of which no view says what it knows: of a sighting, and
            /// what `prediction_weight` is a share of.
            keypoint_sigma_m: f64 = 0.02, "m", 1e-4 to 1.0;
            /// Least weight of such a keypoint, and of a limb against another's (floor of W in (12)).
            min_weight: f64 = 0.05, "", 0.0 to 1.0;
            /// Sigma of the rest-pose prior on degrees of freedom that keypoints do not determine.
            rest_sigma_rad: f64 = 0.35, "rad", 1e-3 to 100.0;
            /// Sigma of the change of a joint angle from the last tick, at 60 Hz.
            change_sigma_rad: f64 = 0.25, "rad", 1e-4 to 100.0;
            /// Weight of the place where a keypoint was predicted or kept along a ray, as a share of a fully supported one's:
            /// enough to carry a limb on, never enough to hold against evidence.
            prediction_weight: f64 = 0.003, "", 0.0 to 1.0;
            /// Expected error of a smoothed joint as a target of the second inverse kinematics.
            joint_sigma_m: f64 = 0.003, "m", 1e-4 to 1.0;
        }
    }

    /// How poses are smoothed: the low-pass filter on the innovation, paper (13).
    smoothing: SmoothingParameters {
        user SmoothingUser {
            /// Delay of a second output that is smoothed with what came after it; 0: there is none.
            delay_ms: f64 = 0.0, "ms", 0.0 to 2000.0;
        }
        tuning SmoothingTuning {
            /// Closed-loop -3 dB frequency for a joint at rest.
            cutoff_hz: f64 = 1.5, "Hz", 0.01 to 1000.0;
            /// How much the cutoff rises with the filtered innovation: fast motion is not held back.
            cutoff_rise_hz_per_m: f64 = 1000.0, "Hz/m", 0.0 to 1e5;
            /// How much the cutoff rises with the joint's speed: what moves fast is not held back, what stands
            /// stays.
            cutoff_rise_per_m: f64 = 4.0, "Hz/(m/s)", 0.0 to 1e3;
            /// Cutoff of the low-pass that the innovation goes through before it raises the cutoff: high enough
            /// to notice the start of a kick within two or three ticks, low enough that the noise of single
            /// ticks averages out.
            innovation_cutoff_hz: f64 = 4.0, "Hz", 0.01 to 1000.0;
            /// Time constant of the decay of a body's velocity while nothing is measured: who runs mostly runs on.
            coast_decay_s: f64 = 1.0, "s", 1e-3 to 1e3;
            /// The same of what moves against the body: limbs that coast at full speed leave it within half a
            /// second.
            limb_decay_s: f64 = 0.25, "s", 1e-3 to 1e3;
        }
    }

    /// Where persons will be, paper (3).
    prediction: PredictionParameters {
        tuning PredictionTuning {
            /// The formula.
            predictor: Predictor = Predictor::DampedVelocity;
            /// Time constant of the decay of what joints move by beside the body as a whole.
            velocity_decay_s: f64 = 0.25, "s", 1e-3 to 1e3;
            /// Time constant of the decay of the body's velocity, the mean of its joints': a limb turns back
            /// soon, who runs goes on.
            body_velocity_decay_s: f64 = 1.0, "s", 1e-3 to 1e3;
        }
    }

    /// The hard bounds of the joint angles in the second inverse kinematics, paper (14).
    range_of_motion: RangeOfMotionParameters {
        user RangeOfMotionUser {
            /// Whether the bounds hold.
            enabled: bool = true;
            /// Factor on the clinical ranges, for athletes.
            factor: f64 = 1.0, "", 0.5 to 2.0;
        }
    }

    /// The predicted image regions, paper (2) and (4).
    boxes: BoxParameters {
        user BoxUser {
            /// The margin m around the projected joints, as a factor.
            margin: Option<f64> = None => "1.25" or "the network card's `box_margin`, else 1.25", "", 1.0 to 4.0;
        }
        tuning BoxTuning {
            /// Whether boxes turn with the body.
            rotate: bool = true;
            /// Tilt of the trunk from which a box turns.
            rotate_from_deg: f64 = 40.0, "deg", 0.0 to 180.0;
            /// Tilt below which a turned box is upright again (hysteresis): at most `rotate_from_deg`.
            rotate_until_deg: f64 = 30.0, "deg", 0.0 to 180.0;
            /// A trunk that is seen shorter than this share of its length is seen end-on, and the box stays
            /// upright.
            end_on_ratio: f64 = 0.5, "", 0.0 to 1.0;
            /// How much people speed up or turn while a box is on its way: boxes hold where they may be by then.
            acceleration_m_s2: f64 = 3.0, "m/s2", 0.0 to 100.0;
            /// From which camera of a viewpoint a person is cropped.
            camera_choice: CameraChoice = CameraChoice::BestView;
        }
    }

    /// How people are found, kept and let go.
    births: BirthParameters {
        user BirthUser {
            /// Time between two regular detection passes, which find people without boxes.
            sight_every_s: f64 = 1.0, "s", 0.0 to 3600.0;
            /// Most tiles that the detector runs on beside the whole picture, per camera and detection pass, where
            /// people are too small in it; if more are needed, parts of the field take turns; 0: none.
            tiles_per_look: u32 = 8, "tiles", 0.0 to 256.0;
            /// Most of its ticks at which a camera has a detection pass, as a share: what fusion asks for beside the
            /// regular passes waits when there were more (the bound over any n ticks is this share of n,
            /// `look_again_s`, and the regular passes).
            look_share: f64 = 0.25, "", 0.0 to 1.0;
            /// How long a person is carried by the model alone.
            coast_s: f64 = 1.0, "s", 0.0 to 3600.0;
            /// How long a person is carried on while a single viewpoint sees it.
            one_view_s: f64 = 5.0, "s", 0.0 to 3600.0;
            /// For how long a person who is gone can come back under its id; 0: never (whoever is still carried
            /// on is found again in any case).
            return_s: f64 = 60.0, "s", 0.0 to 86400.0;
            /// How far outside the field a person is let go.
            outside_field_m: f64 = 1.0, "m", 0.0 to 1e3;
        }
        tuning BirthTuning {
            /// Largest distance between the rays of one keypoint from two viewpoints.
            ray_distance_m: f64 = 0.12, "m", 1e-3 to 10.0;
            /// Least score of a sighted keypoint that counts.
            min_score: f64 = 0.3, "", 0.0 to 1.0;
            /// Least keypoints that two sightings must agree on.
            min_keypoints: u32 = 6, "keypoints", 1.0 to 64.0;
            /// How long evidence from two viewpoints takes to confirm a person; at least one tick.
            confirm_s: f64 = 0.2, "s", 0.0 to 3600.0;
            /// How long a tentative person may lack evidence.
            tentative_s: f64 = 0.2, "s", 0.0 to 3600.0;
            /// Fastest that a person who is not seen can have moved.
            return_speed_m_s: f64 = 8.0, "m/s", 0.0 to 100.0;
            /// Keypoints that lie within this of one plane, root mean square, each by its expected error over the
            /// average one's, may be those of a poster.
            flat_m: f64 = 0.04, "m", 0.0 to 1.0;
            /// How far a flat body's keypoints must move to be a person's, the median of them.
            moved_m: f64 = 0.06, "m", 0.0 to 10.0;
            /// How long a flat body that does not move stays tentative until it is rejected as a poster; the
            /// finished ticks of all are held back until it is decided.
            still_s: f64 = 5.0, "s", 0.0 to 60.0;
            /// A sighting within this distance of a tracked person is explained by it.
            explained_m: f64 = 0.35, "m", 0.0 to 10.0;
            /// For how long there is a detection pass at every tick after a sighting that nobody explains.
            look_again_s: f64 = 0.08, "s", 0.0 to 3600.0;
            /// Least keypoints with evidence from two viewpoints for a person to count as seen.
            min_seen_keypoints: u32 = 4, "keypoints", 1.0 to 64.0;
            /// Until when a person's link lengths are due to be measured anew, 2, 4, 8, ... seconds after its confirmation;
            /// 0: those of the confirmation stay.
            measure_s: f64 = 16.0, "s", 0.0 to 3600.0;
            /// Two persons whose joints are closer than this on average stand in one place.
            same_place_m: f64 = 0.15, "m", 0.0 to 10.0;
            /// For how long two persons may stand in one place until one of them is taken for a second track on
            /// one body.
            same_place_s: f64 = 0.25, "s", 0.0 to 3600.0;
        }
    }

    /// Bytes and delays.
    link: LinkParameters {
        user LinkUser {
            /// How closely maps are kept on the wire: "lossless", "default", "small", "smallest" or a level from 0
            /// to 6.
            quality: Option<CompressionLevel> = None
                => "\"default\"" or "lossless in lock-step, default live, where the link may lower it";
            /// Longest wait for a node in lock-step before the run fails.
            lockstep_timeout_s: f64 = 60.0, "s", 0.1 to 86400.0;
            /// Most that an edge hands to the network in any second, with what the protocols below add to each
            /// message; 0: no bound but what its link carries.
            budget_bytes_per_s: f64 = 0.0, "B/s", 0.0 to 1e9;
            /// Live: longest after a tick that fusion waits for its patches; no longer than links really take.
            deadline_ms: f64 = 400.0, "ms", 1.0 to 5000.0;
            /// Live: how long after its pictures a tick's poses should be out: patches that would come too late for that
            /// are not waited for; 0: no target.
            target_latency_ms: f64 = 0.0, "ms", 0.0 to 5000.0;
            /// Live: an edge whose clock is surely off by more is refused.
            clock_bound_ms: f64 = 100.0, "ms", 1.0 to 10_000.0;
        }
    }

    /// What is kept of a run, and what edges keep for it.
    recording: RecordingParameters {
        user RecordingUser {
            /// Recordings in the same folder that are older are deleted; 0: none.
            retention_days: f64 = 0.0, "days", 0.0 to 36500.0;
            /// Whether poses are recorded as JSON too, for other programs to read: about 3 kB per person and tick.
            json_poses: bool = true;
            /// What an edge keeps on disk of what it sent or could not send when it runs live; 0: nothing.
            ring_mib: u32 = 32, "MiB", 0.0 to 65536.0;
            /// Share of a link's budget that fusion may use to get what an outage has kept from it; 0: holes stay.
            fill_share: f64 = 0.1, "", 0.0 to 1.0;
        }
        tuning RecordingTuning {
            /// Length of a chunk: what a recording loses at most when its process is killed.
            chunk_s: f64 = 1.0, "s", 0.05 to 60.0;
        }
    }
}
