//! By what a ball is told from all else.

use super::colour::ColourRange;

/// By what the thing is told from all else.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Appearance {
    /// By colour alone: for scenes in which nothing large has it.
    Colour(ColourRange),
    /// By colour, of what moves: where seats or signs have it too. The camera must stand still.
    MovingColour(ColourRange),
    /// A light in the dark: brightness, 0 to 255, from `least` on.
    Bright {
        /// Least brightness.
        least: u8,
    },
    /// What differs from the still background by `contrast` levels or more: a drone against the sky. The camera must stand
    /// still, and what holds the thing is part of it.
    Moving {
        /// Least difference, levels of 255.
        contrast: u8,
    },
}
