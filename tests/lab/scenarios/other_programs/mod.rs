//! What comes from other programs and goes to them: calibrations, and poses.

mod calibration;
mod exports;
