//! `lab fuzz-corpus`: the corpus between its archive, which is under version control, and the folder of the fuzzers.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use farfield_node::process::NodeError;

use crate::corpus;

/// Arguments of `lab fuzz-corpus`.
#[derive(Debug, clap::Args)]
pub(in crate::commands) struct CorpusArgs {
    #[command(subcommand)]
    direction: CorpusCommand,
    /// The folder of all corpora, as `cargo fuzz` uses it.
    #[arg(long, global = true, value_name = "DIR", default_value = "fuzz/corpus")]
    folder: PathBuf,
    /// The archive.
    #[arg(
        long,
        global = true,
        value_name = "FILE",
        default_value = "fuzz/corpus.tar"
    )]
    archive: PathBuf,
}

/// Direction of the copy.
#[derive(Clone, Copy, Debug, clap::Subcommand)]
enum CorpusCommand {
    /// Write the archive's inputs to the folder.
    Unpack,
    /// Write the folder's inputs with different behaviour to the archive.
    Pack,
}

/// Packs or unpacks.
///
/// # Errors
/// Names the file or folder that cannot be read or written.
pub(in crate::commands) fn corpus(args: &CorpusArgs) -> Result<(), NodeError> {
    let done = match args.direction {
        CorpusCommand::Unpack => unpack(&args.archive, &args.folder),
        CorpusCommand::Pack => pack(&args.folder, &args.archive),
    };
    done.map_err(NodeError::Failed)
}

fn unpack(archive: &Path, folder: &Path) -> anyhow::Result<()> {
    let bytes = fs::read(archive).with_context(|| archive.display().to_string())?;
    let corpus = corpus::read(&bytes).with_context(|| archive.display().to_string())?;
    for ((target, name), bytes) in &corpus {
        let folder = folder.join(target);
        fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
        let path = folder.join(name);
        fs::write(&path, bytes).with_context(|| path.display().to_string())?;
    }
    println!("{} inputs in {}", corpus.len(), folder.display());
    Ok(())
}

fn pack(folder: &Path, archive: &Path) -> anyhow::Result<()> {
    let all = corpus::read_folder(folder)?;
    let kept = corpus::minimised(&all);
    let bytes = corpus::archive(&kept)?;
    fs::write(archive, &bytes).with_context(|| archive.display().to_string())?;
    println!(
        "{} of {} inputs, {} bytes, in {}",
        kept.len(),
        all.len(),
        bytes.len(),
        archive.display()
    );
    Ok(())
}
