//! Disks that are soon full, or that hang: for scenarios and `lab faults`. Mounting them needs root.

use std::fs::{self, File};
use std::io;
use std::path::{Path, PathBuf};
use std::process::{Child, Command};

/// Space on a disk that is soon full, KiB: less than a minute of two people, more than the head of a recording.
const ROOM_KIB: u32 = 600;
/// Size of a disk that can hang, bytes.
const FREEZABLE_BYTES: u64 = 96 << 20;

/// A mounted disk; unmounted when dropped.
#[derive(Debug)]
pub struct SmallDisk(PathBuf);

impl SmallDisk {
    /// Mounts a disk at `path` that is soon full.
    ///
    /// # Errors
    /// The reason: it needs root.
    pub fn mount(path: &Path) -> Result<Self, String> {
        let room = format!("size={ROOM_KIB}k");
        fs::create_dir(path).map_err(|error| error.to_string())?;
        let mut mount = Command::new("mount");
        run_command(mount.args(["-t", "tmpfs", "-o", &room, "tmpfs"]).arg(path))?;
        Ok(Self(path.to_owned()))
    }

    /// Mounts a disk that can hang.
    ///
    /// # Errors
    /// The reason: it needs root and loop devices.
    pub fn mount_freezable(path: &Path) -> Result<Self, String> {
        let image = path.with_extension("image");
        let made = fs::create_dir(path)
            .and_then(|()| File::create(&image))
            .and_then(|file| file.set_len(FREEZABLE_BYTES));
        made.map_err(|error| error.to_string())?;
        run_command(Command::new("mkfs.ext4").arg("-q").arg(&image))?;
        let mut mount = Command::new("mount");
        run_command(mount.args(["-o", "loop"]).arg(&image).arg(path))?;
        Ok(Self(path.to_owned()))
    }

    /// Its mount point.
    pub fn path(&self) -> &Path {
        &self.0
    }

    /// Makes it hang for so many seconds. Another process ends the hang, whatever happens here.
    ///
    /// # Errors
    /// That process cannot be started.
    pub fn freeze(&self, seconds: u32) -> io::Result<Child> {
        let script = format!("fsfreeze -f \"$0\" && sleep {seconds}; fsfreeze -u \"$0\"");
        let mut freeze = Command::new("sh");
        freeze.args(["-c", &script]).arg(&self.0).spawn()
    }

    /// Enlarges a disk of [`Self::mount`].
    ///
    /// # Errors
    /// `mount` fails.
    pub fn grow(&self) -> Result<(), String> {
        let mut mount = Command::new("mount");
        run_command(mount.args(["-o", "remount,size=80m"]).arg(&self.0))
    }
}

fn run_command(command: &mut Command) -> Result<(), String> {
    let output = command.output().map_err(|error| error.to_string())?;
    if output.status.success() {
        Ok(())
    } else {
        Err(String::from_utf8_lossy(&output.stderr).trim().to_owned())
    }
}

impl Drop for SmallDisk {
    fn drop(&mut self) {
        // Lazily, since a node may still have the file open.
        drop(Command::new("umount").arg("-l").arg(&self.0).status());
    }
}
