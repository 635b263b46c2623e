//! How videos are stored, where that is remarkable: the same words in every command that opens one.

use farfield_edge::source::{FormatRemark, SourceInfo};
use farfield_node::process::say;

/// What is remarkable about how the video `named` is stored; nothing of most, and of what is no video.
pub(crate) fn format_remarks(named: &str, info: &SourceInfo) -> Vec<FormatRemark> {
    let mut remarks = info.format.remarks(info.rate_hz);
    for remark in &mut remarks {
        remark.problem = format!("{named} {}", remark.problem);
    }
    remarks
}

/// Says it, line by line.
pub(crate) fn say_format(named: &str, info: &SourceInfo) {
    for remark in format_remarks(named, info) {
        let word = if remark.is_warning {
            "doubtful"
        } else {
            "note"
        };
        let problem = remark.problem;
        say(format_args!("{word}: {problem}; {}", remark.remedy));
    }
}

/// How the video of a camera is named.
pub(crate) fn of_camera(name: &str) -> String {
    format!("camera `{name}`")
}
