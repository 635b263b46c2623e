//! Reports at the end which cameras showed people outside the used field of view.

use farfield_node::process::say;

use crate::pipeline::EdgePipeline;

/// Prints a line per camera of `pipeline` for which content was left out.
pub(super) fn report_beyond_view(pipeline: &EdgePipeline) {
    for (camera, left_out) in pipeline.beyond_view() {
        say(format_args!("camera `{camera}`: {left_out}"));
    }
}
