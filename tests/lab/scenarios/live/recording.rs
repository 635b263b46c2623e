//! Recordings of a live run when the disk is full.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::process::Command;

use farfield_fusion::recording::reader::Recording;

use super::stage::LiveStage;

/// Room on the small disk: less than a minute of the stage, more than the head of a recording.
const SIZE: &str = "size=600k";

/// A disk of its own that is soon full; gone when dropped.
struct SmallDisk(PathBuf);

impl SmallDisk {
    /// Mounts one at `path`.
    ///
    /// # Errors
    /// Why there is none: it takes root.
    fn mount(path: &Path) -> Result<Self, String> {
        std::fs::create_dir(path).unwrap();
        let mut mount = Command::new("mount");
        mount.args(["-t", "tmpfs", "-o", SIZE, "tmpfs"]).arg(path);
        let output = mount.output().map_err(|error| error.to_string())?;
        if output.status.success() {
            Ok(Self(path.to_owned()))
        } else {
            Err(String::from_utf8_lossy(&output.stderr).trim().to_owned())
        }
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        // Lazily: a node may still have the file open.
        drop(Command::new("umount").arg("-l").arg(&self.0).status());
    }
}

#[test]
fn a_full_disk_ends_the_recording_with_a_clear_error_and_capture_goes_on() {
    let mut stage = LiveStage::prepare(&[], "");
    let disk = match SmallDisk::mount(&stage.folder.path().join("disk")) {
        Ok(disk) => disk,
        Err(reason) => {
            println!("SKIPPED a full disk: cannot mount a small one: {reason}");
            return;
        }
    };
    let record = disk.0.join("run.mcap");
    let out = stage.out("first");
    let path = record.to_str().unwrap();
    stage.start_with(&out, &["--record", path]);
    let fusion = || stage.live.fusion.as_ref().unwrap();
    stage.wait("the recording ends", |_| {
        fusion().said().contains("has ended")
    });
    let said = fusion().said();
    assert!(said.contains("run.mcap"), "{said}");
    let before = stage.takes();
    stage.go_on(3.0);
    before.assert_flat(&stage.takes());
    let recording = Recording::open(File::open(&record).unwrap()).unwrap();
    let part = &recording.sessions()[0];
    println!(
        "{} sets can be read, of ticks {} to {}",
        part.sets, part.ticks[0], part.ticks[1]
    );
    assert!(part.sets > 0);
}
