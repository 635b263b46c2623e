//! Every parameter: table, name, type, default, unit, range and description. This is the only place
//! of this information.
//!
//! `user`: a choice at a venue, in the venue file's table of this name. `tuning`: a number of the
//! method, under `[tuning]`.

use super::choices::{CameraChoice, Predictor};
use super::declare::declare_parameters;
use crate::patch::CompressionLevel;

declare_parameters! {
    /// The search for the most probable keypoint positions, paper (6)-(8).
    lattice: LatticeParameters {
        tuning LatticeTuning {
            /// How far from the prediction a keypoint is searched along each axis (s k of the
            /// paper).
            half_width_m: f64 = 0.25, "m", 0.01 to 2.0;
            /// Step of the coarse pass, in map cells of the finest view: below the width of a peak
            /// (sigma 2 cells), or the search steps over it.
            coarse_step_cells: f64 = 2.0, "cells", 0.1 to 16.0;
            /// Fine steps per coarse step.
            fine_per_coarse: u32 = 4, "", 1.0 to 32.0;
            /// Sigma of the Gaussian around the prediction that weights candidates: the other ankle
            /// is inside the lattice.
            prior_sigma_m: f64 = 0.20, "m", 0.005 to 10.0;
            /// Uncertainty of a limb's velocity. Times the time since the last measurement (up to
            /// 0.25 s and a tick) it is the sigma, if that exceeds `prior_sigma_m`.
            prior_speed_m_s: f64 = 6.0, "m/s", 0.0 to 100.0;
            /// Weighted mean of the maps below which a keypoint counts as unsupported and falls
            /// back to the prediction with weight 0.
            min_support: f64 = 0.08, "", 0.0 to 1.0;
            /// Angle between two viewpoints' rays below which they do not count as independent.
            independent_angle_deg: f64 = 8.0, "deg", 0.0 to 90.0;
        }
    }

    /// The weight of a map while another body is in front, paper (9).
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

    /// People in contact, and swapped sides.
    contact: ContactParameters {
        tuning ContactTuning {
            /// Share of a peak that a person loses when it certainly belongs to another person; 0:
            /// peaks are not assigned.
            yield_share: f64 = 0.8, "", 0.0 to 1.0;
            /// Expected error of the prediction of a keypoint that two viewpoints observed at the
            /// last tick.
            seen_sigma_m: f64 = 0.06, "m", 1e-3 to 10.0;
            /// Expected error of the prediction of a keypoint that two viewpoints did not observe
            /// at the last tick.
            unseen_sigma_m: f64 = 0.12, "m", 1e-3 to 10.0;
            /// Excess of the crosswise over the straight reading of both maps of a left and a right
            /// from which the view counts as swapped; above 1: left-right swaps are not undone.
            exchange_margin: f64 = 0.25, "", 1e-3 to 2.0;
            /// Cost of limbs of two people that penetrate each other, as a share of a fully
            /// supported keypoint's weight; 0: no cost.
            separation_weight: f64 = 0.01, "", 0.0 to 100.0;
            /// Thickness of bodies that keep apart, as a share of the radii of `occlusion`.
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
            /// Expected error of a fully supported keypoint without an estimate from any view: of a
            /// sighting, and the reference of `prediction_weight`.
            keypoint_sigma_m: f64 = 0.02, "m", 1e-4 to 1.0;
            /// Minimum weight of such a keypoint, and of a limb against another's (floor of W in
            /// (12)).
            min_weight: f64 = 0.05, "", 0.0 to 1.0;
            /// Sigma of the rest-pose prior on degrees of freedom that keypoints do not determine.
            rest_sigma_rad: f64 = 0.35, "rad", 1e-3 to 100.0;
            /// Sigma of the change of a joint angle from the last tick, at 60 Hz.
            change_sigma_rad: f64 = 0.25, "rad", 1e-4 to 100.0;
            /// Weight of the predicted position of a keypoint, or of one kept along a ray, as a
            /// share of a fully supported one's: enough to continue a limb's motion, never enough
            /// to resist evidence.
            prediction_weight: f64 = 0.003, "", 0.0 to 1.0;
            /// Expected error of a smoothed joint as a target of the second inverse kinematics.
            joint_sigma_m: f64 = 0.003, "m", 1e-4 to 1.0;
        }
    }

    /// Smoothing of poses: the low-pass filter on the innovation, paper (13).
    smoothing: SmoothingParameters {
        user SmoothingUser {
            /// Delay of a second output that is also smoothed with later data; 0: no such output.
            delay_ms: f64 = 0.0, "ms", 0.0 to 2000.0;
        }
        tuning SmoothingTuning {
            /// Closed-loop -3 dB frequency for a joint at rest.
            cutoff_hz: f64 = 1.5, "Hz", 0.01 to 1000.0;
            /// Rise of the cutoff with the filtered innovation, so that fast motion is not delayed.
            cutoff_rise_hz_per_m: f64 = 1000.0, "Hz/m", 0.0 to 1e5;
            /// Rise of the cutoff with the joint's speed: fast motion is not delayed, and a still
            /// person does not jitter.
            cutoff_rise_per_m: f64 = 4.0, "Hz/(m/s)", 0.0 to 1e3;
            /// Cutoff of the low-pass on the innovation before it raises the cutoff: high enough to
            /// detect the start of a kick within two or three ticks, low enough to average out the
            /// noise of single ticks.
            innovation_cutoff_hz: f64 = 4.0, "Hz", 0.01 to 1000.0;
            /// Time constant of the decay of a body's velocity without measurements: a person who
            /// runs usually continues.
            coast_decay_s: f64 = 1.0, "s", 1e-3 to 1e3;
            /// The same for motion relative to the body: limbs that coast at full speed leave it
            /// within half a second.
            limb_decay_s: f64 = 0.25, "s", 1e-3 to 1e3;
        }
    }

    /// Prediction of people's positions, paper (3).
    prediction: PredictionParameters {
        tuning PredictionTuning {
            /// The formula.
            predictor: Predictor = Predictor::DampedVelocity;
            /// Time constant of the decay of joint velocities relative to the body as a whole.
            velocity_decay_s: f64 = 0.25, "s", 1e-3 to 1e3;
            /// Time constant of the decay of the body's velocity, the mean of its joints': a limb
            /// soon turns back, a runner continues.
            body_velocity_decay_s: f64 = 1.0, "s", 1e-3 to 1e3;
        }
    }

    /// The hard bounds of the joint angles in the second inverse kinematics, paper (14).
    range_of_motion: RangeOfMotionParameters {
        user RangeOfMotionUser {
            /// Whether the bounds apply.
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
            /// Whether boxes rotate with the body.
            rotate: bool = true;
            /// Tilt of the trunk from which a box rotates.
            rotate_from_deg: f64 = 40.0, "deg", 0.0 to 180.0;
            /// Tilt below which a rotated box is upright again (hysteresis): at most
            /// `rotate_from_deg`.
            rotate_until_deg: f64 = 30.0, "deg", 0.0 to 180.0;
            /// A trunk that appears shorter than this share of its length is seen end-on, and the
            /// box stays upright.
            end_on_ratio: f64 = 0.5, "", 0.0 to 1.0;
            /// Largest acceleration of people while a box is on its way, that of a sprinter who
            /// starts: boxes include the positions that this allows.
            acceleration_m_s2: f64 = 10.0, "m/s2", 0.0 to 100.0;
            /// The camera of a viewpoint from which a person is cropped.
            camera_choice: CameraChoice = CameraChoice::BestView;
        }
    }

    /// Detection of people, and the life of their tracks.
    births: BirthParameters {
        user BirthUser {
            /// Time between two regular detection passes, which find people without boxes.
            sight_every_s: f64 = 1.0, "s", 0.0 to 3600.0;
            /// Largest number of tiles for the detector in addition to the whole picture, per
            /// camera and detection pass, where people are too small in it; if more are needed,
            /// parts of the field take turns; 0: none.
            tiles_per_look: u32 = 8, "tiles", 0.0 to 256.0;
            /// Largest share of its ticks with a detection pass of a camera; requests of fusion
            /// beyond the regular passes wait above it (the bound over any n ticks is this share of
            /// n, plus `look_again_s`, plus the regular passes).
            look_share: f64 = 0.25, "", 0.0 to 1.0;
            /// How long the model alone carries a person without views.
            coast_s: f64 = 1.0, "s", 0.0 to 3600.0;
            /// How long a person is tracked while only one viewpoint sees it.
            one_view_s: f64 = 5.0, "s", 0.0 to 3600.0;
            /// How long a person who has left can return with the same id; 0: never (a person who
            /// is still carried is found again in any case).
            return_s: f64 = 60.0, "s", 0.0 to 86400.0;
            /// Distance outside the field at which a person is dropped.
            outside_field_m: f64 = 1.0, "m", 0.0 to 1e3;
        }
        tuning BirthTuning {
            /// Largest distance between the rays of one keypoint from two viewpoints.
            ray_distance_m: f64 = 0.12, "m", 1e-3 to 10.0;
            /// Minimum score of a sighted keypoint that counts.
            min_score: f64 = 0.3, "", 0.0 to 1.0;
            /// Minimum number of keypoints on which two sightings must agree.
            min_keypoints: u32 = 6, "keypoints", 1.0 to 64.0;
            /// Duration of evidence from two viewpoints that confirms a person; at least one tick.
            confirm_s: f64 = 0.2, "s", 0.0 to 3600.0;
            /// How long a tentative person may lack evidence.
            tentative_s: f64 = 0.2, "s", 0.0 to 3600.0;
            /// Largest speed of an unseen person.
            return_speed_m_s: f64 = 8.0, "m/s", 0.0 to 100.0;
            /// Keypoints within this distance of one plane (root mean square, weighted by their
            /// expected errors over the average error) may belong to a poster.
            flat_m: f64 = 0.04, "m", 0.0 to 1.0;
            /// Median motion of a flat body's keypoints from which it is a person.
            moved_m: f64 = 0.06, "m", 0.0 to 10.0;
            /// How long a flat body that does not move stays tentative until it is rejected as a
            /// poster; finished ticks of all people wait for the decision.
            still_s: f64 = 5.0, "s", 0.0 to 60.0;
            /// A sighting within this distance of a tracked person belongs to it.
            explained_m: f64 = 0.35, "m", 0.0 to 10.0;
            /// How long there is a detection pass at every tick after a sighting that belongs to no
            /// person.
            look_again_s: f64 = 0.08, "s", 0.0 to 3600.0;
            /// Minimum number of keypoints with evidence from two viewpoints for a person to count
            /// as seen.
            min_seen_keypoints: u32 = 4, "keypoints", 1.0 to 64.0;
            /// How long a person's link lengths are measured again, 2, 4, 8, ... seconds after the
            /// confirmation; 0: those of the confirmation stay.
            measure_s: f64 = 16.0, "s", 0.0 to 3600.0;
            /// Two people whose joints are closer than this on average are in one place.
            same_place_m: f64 = 0.15, "m", 0.0 to 10.0;
            /// How long two people may be in one place until one of them counts as a second track
            /// on the same body.
            same_place_s: f64 = 0.25, "s", 0.0 to 3600.0;
        }
    }

    /// Bandwidth and delays.
    link: LinkParameters {
        user LinkUser {
            /// Compression of maps on the wire: "lossless", "default", "small", "smallest" or a
            /// level from 0 to 6.
            quality: Option<CompressionLevel> = None
                => "\"default\"" or "lossless in lock-step, default live, where the link may lower it";
            /// Longest wait for a node in lock-step before the run fails.
            lockstep_timeout_s: f64 = 60.0, "s", 0.1 to 86400.0;
            /// Largest number of bytes that an edge sends in any second, including the overhead of
            /// the protocols per message; 0: only the limit of its link.
            budget_bytes_per_s: f64 = 0.0, "B/s", 0.0 to 1e9;
            /// Live: longest time after a tick that fusion waits for its patches; shorter if the
            /// links are faster.
            deadline_ms: f64 = 400.0, "ms", 1.0 to 5000.0;
            /// Live: target delay from a tick's pictures to its poses: fusion does not wait for
            /// patches that are too late for it; 0: no target.
            target_latency_ms: f64 = 0.0, "ms", 0.0 to 5000.0;
            /// Live: an edge whose clock is certainly off by more is refused.
            clock_bound_ms: f64 = 100.0, "ms", 1.0 to 10_000.0;
        }
    }

    /// Recordings, and the stores of edges for them.
    recording: RecordingParameters {
        user RecordingUser {
            /// Older recordings in the same folder are deleted; 0: none.
            retention_days: f64 = 0.0, "days", 0.0 to 36500.0;
            /// Whether poses are also recorded as JSON, for other programs: about 3 kB per person
            /// and tick.
            json_poses: bool = true;
            /// Size of an edge's store on disk for sent and unsent sets in live mode; 0: no store.
            ring_mib: u32 = 32, "MiB", 0.0 to 65536.0;
            /// Share of a link's budget for the data of an outage, requested later; 0: holes stay.
            fill_share: f64 = 0.1, "", 0.0 to 1.0;
        }
        tuning RecordingTuning {
            /// Length of a chunk: the largest loss of a recording when its process is killed.
            chunk_s: f64 = 1.0, "s", 0.05 to 60.0;
        }
    }
}
