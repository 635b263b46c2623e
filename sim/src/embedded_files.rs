//! The list of embedded text files, by name.

/// The motion clips, BVH text by name.
pub const CLIPS: &[(&str, &str)] = &[
    ("walk", include_str!("../clips/walk.bvh")),
    ("jog", include_str!("../clips/jog.bvh")),
    ("run", include_str!("../clips/run.bvh")),
    ("sprint", include_str!("../clips/sprint.bvh")),
    ("idle", include_str!("../clips/idle.bvh")),
    ("turn", include_str!("../clips/turn.bvh")),
    ("wave", include_str!("../clips/wave.bvh")),
    ("kick", include_str!("../clips/kick.bvh")),
    ("jump", include_str!("../clips/jump.bvh")),
    ("lift", include_str!("../clips/lift.bvh")),
    ("punch", include_str!("../clips/punch.bvh")),
    ("guard", include_str!("../clips/guard.bvh")),
    ("cartwheel", include_str!("../clips/cartwheel.bvh")),
];

/// The scenes, TOML text by name; the first line of each states its purpose.
pub const SCENES: &[(&str, &str)] = &[
    ("court", include_str!("../scenes/court.toml")),
    ("one", include_str!("../scenes/one.toml")),
    ("inverted", include_str!("../scenes/inverted.toml")),
    ("facing", include_str!("../scenes/facing.toml")),
    (
        "facing-inverted",
        include_str!("../scenes/facing-inverted.toml"),
    ),
    ("five", include_str!("../scenes/five.toml")),
    (
        "five-inverted",
        include_str!("../scenes/five-inverted.toml"),
    ),
    ("futsal", include_str!("../scenes/futsal.toml")),
    ("sprint", include_str!("../scenes/sprint.toml")),
    ("enter", include_str!("../scenes/enter.toml")),
    ("blocked", include_str!("../scenes/blocked.toml")),
    ("cross", include_str!("../scenes/cross.toml")),
    ("hug", include_str!("../scenes/hug.toml")),
    ("scrum", include_str!("../scenes/scrum.toml")),
    ("long-hug", include_str!("../scenes/long-hug.toml")),
    ("side-by-side", include_str!("../scenes/side-by-side.toml")),
    ("stage", include_str!("../scenes/stage.toml")),
    ("legs", include_str!("../scenes/legs.toml")),
    ("lost", include_str!("../scenes/lost.toml")),
    ("return", include_str!("../scenes/return.toml")),
    ("mirror", include_str!("../scenes/mirror.toml")),
    ("poster", include_str!("../scenes/poster.toml")),
];
