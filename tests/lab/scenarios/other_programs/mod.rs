//! What comes from other programs and goes to them: calibrations, and poses.

mod all_stages;
mod ball;
mod boards_stage;
mod calibration;
mod clicked_marks;
mod exports;
mod filmed_people;
mod import;
mod people;
mod seen_hall;
mod subjects;
mod walked_calibration;
