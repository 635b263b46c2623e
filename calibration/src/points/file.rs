//! Text files with sightings of a moving point: one per camera, `frame x y` per line.

use std::path::Path;

use farfield_proto::toml_file::FileError;

/// A sighting of the point in a camera.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Sighting {
    /// The frame of the camera's own video; it can be fractional.
    pub frame: f64,
    /// Column and row, distorted pixels; (0, 0) is the centre of the first.
    pub px: [f64; 2],
}

/// Most lines of a file: 14 hours at 200 Hz.
const MOST_LINES: usize = 10_000_000;
/// Largest absolute coordinate.
const LARGEST_PX: f64 = 1e6;
/// Largest frame.
const LARGEST_FRAME: f64 = 1e9;

/// Reads the text of one camera's file; `path` is only for errors.
///
/// A line has a frame, x and y, separated by blanks, tabs, commas or semicolons. Empty lines and lines that begin with `#` or
/// `%` are ignored, and the first other line can be a heading. A position of `nan nan` or of exactly `0 0` means that the
/// point was not seen in that frame. Frames must not decrease, and a frame has one position.
///
/// # Errors
/// [`FileError`] with the line: not three numbers, a number out of range, a frame that decreases or has two positions, no
/// sighting at all.
pub fn parse(text: &str, path: &Path) -> Result<Vec<Sighting>, FileError> {
    let mut sightings: Vec<Sighting> = Vec::new();
    let mut last_frame = f64::NEG_INFINITY;
    let mut is_first = true;
    let mut is_last_seen = false;
    for (index, line) in text.lines().enumerate() {
        let wrong = |problem: String| FileError::new(path, problem).at_line(index + 1);
        if index >= MOST_LINES {
            return Err(wrong(format!("more than {MOST_LINES} lines")));
        }
        let line = line.trim().trim_start_matches('\u{feff}');
        if line.is_empty() || line.starts_with(['#', '%']) {
            continue;
        }
        let may_be_heading = std::mem::take(&mut is_first);
        // `nan 1 2` begins with a letter but is a sighting without a frame, not a heading.
        let first = line.split(is_between).find(|part| !part.is_empty());
        let is_number = first.is_some_and(|part| part.parse::<f64>().is_ok());
        if may_be_heading && !is_number && line.starts_with(char::is_alphabetic) {
            continue;
        }
        let [frame, x, y] = numbers(line).map_err(wrong)?;
        if !(0.0..=LARGEST_FRAME).contains(&frame) {
            return Err(wrong(format!(
                "found frame {frame}, expected 0 to {LARGEST_FRAME:e}"
            )));
        }
        if frame < last_frame {
            return Err(wrong(format!(
                "found frame {frame} after frame {last_frame}, expected frames that do not decrease"
            )));
        }
        let is_repeated = frame <= last_frame && is_last_seen;
        last_frame = frame;
        if !is_repeated {
            is_last_seen = false;
        }
        if (x.is_nan() && y.is_nan()) || (x == 0.0 && y == 0.0) {
            continue;
        }
        let is_pixel = |v: f64| v.abs() <= LARGEST_PX;
        if !(is_pixel(x) && is_pixel(y)) {
            return Err(wrong(format!("found ({x}, {y}), expected pixels")));
        }
        if is_repeated {
            let first = sightings.last().map(|s| s.px);
            if first == Some([x, y]) {
                continue;
            }
            return Err(wrong(format!(
                "found frame {frame} a second time, with another position, expected one sighting per frame"
            )));
        }
        is_last_seen = true;
        sightings.push(Sighting { frame, px: [x, y] });
    }
    if sightings.is_empty() {
        return Err(FileError::new(
            path,
            "the file has no sighting, expected lines of `frame x y`",
        ));
    }
    Ok(sightings)
}

/// Whether a character separates two values of a line.
fn is_between(c: char) -> bool {
    c.is_whitespace() || matches!(c, ',' | ';')
}

fn numbers(line: &str) -> Result<[f64; 3], String> {
    let parts: Vec<&str> = line
        .split(is_between)
        .filter(|part| !part.is_empty())
        .collect();
    let [frame, x, y] = parts.as_slice() else {
        return Err(format!(
            "found {} values, expected 3: `frame x y`",
            parts.len()
        ));
    };
    let number = |part: &str| {
        part.parse::<f64>()
            .map_err(|_| format!("found `{part}`, expected a number"))
    };
    Ok([number(frame)?, number(x)?, number(y)?])
}

/// Reads `points.dat` and `IdMat.dat` of `MultiCamSelfCal`: three rows per camera (x, y, 1), with a column per frame; and one
/// row per camera, 1 where it saw the point. Returns one list of sightings per camera; both paths are only for errors.
///
/// # Errors
/// [`FileError`] with the line: not numbers, rows of different lengths, numbers of rows that do not match.
pub fn parse_multicamselfcal(
    points: (&str, &Path),
    seen: (&str, &Path),
) -> Result<Vec<Vec<Sighting>>, FileError> {
    let seen_rows = rows(seen.0, seen.1)?;
    let point_rows = rows(points.0, points.1)?;
    if point_rows.len() != 3 * seen_rows.len() || seen_rows.is_empty() {
        let problem = format!(
            "found {} rows, expected three for each of the {} rows of {}",
            point_rows.len(),
            seen_rows.len(),
            seen.1.display()
        );
        return Err(FileError::new(points.1, problem));
    }
    let frames = seen_rows.first().map_or(0, Vec::len);
    let is_other = |row: &Vec<f64>| row.len() != frames;
    if let Some(row) = seen_rows
        .iter()
        .chain(&point_rows)
        .find(|row| is_other(row))
    {
        let problem = format!(
            "found a row of {} numbers, expected {frames} as in the first row",
            row.len()
        );
        return Err(FileError::new(points.1, problem));
    }
    let cameras = seen_rows.iter().zip(point_rows.chunks_exact(3));
    let read = cameras.map(|(seen, rows)| {
        let columns = rows[0].iter().zip(&rows[1]).zip(seen).enumerate();
        columns
            .filter(|(_, ((x, y), seen))| **seen != 0.0 && x.is_finite() && y.is_finite())
            .map(|(frame, ((x, y), _))| Sighting {
                frame: frame as f64,
                px: [*x, *y],
            })
            .collect()
    });
    Ok(read.collect())
}

fn rows(text: &str, path: &Path) -> Result<Vec<Vec<f64>>, FileError> {
    let lines = text.lines().enumerate();
    lines
        .filter(|(_, line)| !line.trim().is_empty())
        .map(|(index, line)| {
            let numbers = line.split_whitespace().map(|part| {
                part.parse::<f64>().map_err(|_| {
                    let problem = format!("found `{part}`, expected a number");
                    FileError::new(path, problem).at_line(index + 1)
                })
            });
            numbers.collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<Vec<Sighting>, String> {
        parse(text, Path::new("cam0.txt")).map_err(|error| error.to_string())
    }

    #[test]
    fn a_heading_commas_and_unseen_frames_are_read() {
        let text = " frame no.  x  y\n1.000  10.5 20\n2 0 0\n3, 11.5, 21\n\n# end\n4\tnan\tnan\n";
        let found = read(text).unwrap();
        assert_eq!(found.len(), 2);
        assert_eq!(
            found[1],
            Sighting {
                frame: 3.0,
                px: [11.5, 21.0]
            }
        );
    }

    #[test]
    fn invalid_files_are_refused_with_their_line() {
        for (text, expected) in [
            ("1 2 3\n2 x 3\n", "found `x`, expected a number"),
            ("1 2 3\n2 3\n", "found 2 values, expected 3"),
            ("2 2 3\n1 2 3\n", "expected frames that do not decrease"),
            ("1 2 3\n1 2 4\n", "a second time"),
            ("1 2 3\n2 inf 3\n", "expected pixels"),
            ("1 2 3\n-1 2 3\n", "found frame -1"),
        ] {
            let error = read(text).unwrap_err();
            assert!(error.contains(expected) && error.contains('2'), "{error}");
        }
        assert!(
            read("nan 1 2\n3 4 5\n")
                .unwrap_err()
                .contains("found frame NaN")
        );
        assert!(read("frame x y\n").unwrap_err().contains("no sighting"));
    }

    #[test]
    fn a_matrix_of_points_is_read() {
        let (points, seen) = (
            "1 2 3\n4 5 6\n1 1 1\n7 8 9\n1 2 3\n1 1 1\n",
            "1 0 1\n0 1 1\n",
        );
        let path = Path::new("points.dat");
        let found = parse_multicamselfcal((points, path), (seen, path)).unwrap();
        assert_eq!(found[0].len(), 2);
        assert_eq!(
            found[1][0],
            Sighting {
                frame: 1.0,
                px: [8.0, 2.0]
            }
        );
        let short = parse_multicamselfcal(("1 2\n", path), (seen, path));
        assert!(short.is_err());
    }
}
