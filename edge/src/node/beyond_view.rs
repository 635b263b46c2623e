//! Says at the end which cameras showed people where nothing of their view is used.

use farfield_node::process::say;

use crate::pipeline::EdgePipeline;

/// A line per camera of `pipeline` of which something was left out.
pub(super) fn say_beyond_view(pipeline: &EdgePipeline) {
    for (camera, left_out) in pipeline.beyond_view() {
        say(format_args!("camera `{camera}`: {left_out}"));
    }
}
