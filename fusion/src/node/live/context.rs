//! What a live run is given, and what may stop it.

use std::path::Path;

use farfield_proto::id::SessionId;
use tokio_util::sync::CancellationToken;

use super::super::config::FusionConfig;
use super::super::recording::{RecordingThread, RecordingsOnDemand};
use crate::node::output::progress::Reporter;
use crate::node::output::summary_file::SummaryFile;
use crate::node::session::interceptor::Interceptor;
use crate::node::session::link::FusionEnds;
use crate::node::session::other_fusion::OtherFusionWatch;

/// What a live run works with.
pub(in crate::node) struct LiveContext<'a> {
    pub(in crate::node) config: &'a FusionConfig,
    pub(in crate::node) session: SessionId,
    /// Where the results go.
    pub(in crate::node) out: &'a Path,
    pub(in crate::node) summary: &'a mut SummaryFile,
    /// Who records, if anybody does.
    pub(in crate::node) recording: Option<&'a RecordingThread>,
    /// What starts and stops recordings while the run goes on, where somebody may.
    pub(in crate::node) on_demand: Option<&'a RecordingsOnDemand>,
    pub(in crate::node) interceptor: &'a Interceptor,
    pub(in crate::node) ends: &'a mut FusionEnds,
    pub(in crate::node) reporter: &'a mut Reporter,
    pub(in crate::node) stop: &'a CancellationToken,
    /// Who looks for another fusion of the venue.
    pub(in crate::node) others: OtherFusionWatch,
}
