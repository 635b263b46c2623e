//! Data from and for other programs: calibrations, keypoints and poses.

mod all_stages;
mod ball;
mod boards_stage;
mod calibration;
mod clicked_marks;
mod exports;
mod filmed_people;
mod import;
mod people;
mod subjects;
mod walked_calibration;
