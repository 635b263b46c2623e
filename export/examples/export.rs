//! Writes a run folder in the formats that are named, or all: `cargo run -p farfield-export --example export -- RUN OUT [FORMAT...] [OPTION=VALUE...]`.

use std::path::PathBuf;

use farfield_export::{Existing, ExportRequest, Format, Options, export};

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [run, out, rest @ ..] = arguments.as_slice() else {
        return Err("expected a run folder and a folder to write to".into());
    };
    let run = PathBuf::from(run);
    let mut options = Options::default();
    let mut formats = Vec::new();
    for word in rest {
        match word.split_once('=') {
            None => formats.push(word.parse()?),
            Some(("lengths", value)) => options.lengths = value.parse()?,
            Some(("names", value)) => options.names = value.parse()?,
            Some(("rest", value)) => options.rest = value.parse()?,
            Some(("gaps", value)) => options.gaps = value.parse()?,
            Some(("preset", value)) => options.preset = Some(value.parse()?),
            Some(("rate_hz", value)) => options.rate_hz = Some(value.parse()?),
            Some((key, _)) => return Err(format!("`{key}` is no option").into()),
        }
    }
    if formats.is_empty() {
        formats = Format::ALL.map(|(_, format)| format).to_vec();
    }
    let request = ExportRequest {
        poses: run.join("poses.jsonl"),
        summary: run.join("summary.json"),
        out: out.into(),
        formats,
        options,
        existing: Existing::Replace,
    };
    for written in export(&request, |_| ())? {
        println!("{} {}", written.path.display(), written.bytes);
    }
    Ok(())
}
