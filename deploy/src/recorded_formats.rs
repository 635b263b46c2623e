//! How videos are stored, where that is remarkable: the same words in every command that opens one.

use farfield_edge::source::SourceInfo;
use farfield_node::process::say;
use farfield_proto::finding::Advice;

/// What is remarkable about how the video `named` is stored; nothing of most, and of what is no video.
pub(crate) fn format_remarks(named: &str, info: &SourceInfo) -> impl Iterator<Item = Advice> {
    let remarks = info.format.remarks(info.rate_hz).into_iter();
    remarks.map(move |it| it.of(named))
}

/// Says it, line by line.
pub(crate) fn say_format(named: &str, info: &SourceInfo) {
    for remark in format_remarks(named, info) {
        say(format_args!("{remark}"));
    }
}

/// How the video of a camera is named.
pub(crate) fn of_camera(name: &str) -> String {
    format!("camera `{name}`")
}
