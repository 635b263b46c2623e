//! Parquet: all people in one table, one row per person and frame, one column per number.
//!
//! Columns are those of the wide CSV, preceded by the person's id and name. Positions and angles
//! are f32, absent frames are omitted, and unknown values are null, including angles that come from
//! a prior. Metres, z up, unless a preset is given. Uncompressed, since the codecs are not built
//! in. Rows are written in groups of 2048, which limits the memory.

use std::io::{self, Write};
use std::sync::Arc;

use farfield_fusion::body::skeleton::ANGLE_NAMES;
use farfield_fusion::body::skeleton::angles::is_translation;
use parquet::basic::{LogicalType, Repetition, Type as Physical};
use parquet::data_type::{ByteArray, ByteArrayType, DataType, DoubleType, FloatType, Int32Type};
use parquet::file::properties::WriterProperties;
use parquet::file::writer::{SerializedFileWriter, SerializedRowGroupWriter};
use parquet::schema::types::Type;

use super::table::{Style, origin, state};
use super::{names, points};
use crate::subject::Subject;
use crate::timeline::Frame;

/// Rows per group.
const ROWS: usize = 2048;

/// Writes people one after the other.
pub struct ParquetWriter<W: Write + Send> {
    out: SerializedFileWriter<W>,
    style: Style,
    rows: Rows,
}

/// Rows not yet written, by column.
#[derive(Debug, Default)]
struct Rows {
    times_s: Vec<f64>,
    ticks: Vec<f64>,
    people: Vec<i32>,
    names: Vec<ByteArray>,
    origins: Vec<ByteArray>,
    states: Vec<ByteArray>,
    views: Vec<i32>,
    numbers: Vec<Vec<Option<f32>>>,
}

fn failed(error: parquet::errors::ParquetError) -> io::Error {
    io::Error::other(error)
}

impl<W: Write + Send> ParquetWriter<W> {
    /// Writes the header; `subject` is any of the following ones.
    ///
    /// # Errors
    /// Errors of `out`.
    pub fn new(out: W, subject: &Subject<'_>) -> io::Result<Self> {
        let style = Style::for_subject(subject);
        let column =
            |name: &str, kind: Physical, logical: Option<LogicalType>, repetition: Repetition| {
                let column = Type::primitive_type_builder(name, kind);
                let column = column
                    .with_logical_type(logical)
                    .with_repetition(repetition);
                column.build().map(Arc::new).map_err(failed)
            };
        let number = |name: &str, kind| column(name, kind, None, Repetition::REQUIRED);
        let text = |name: &str| {
            column(
                name,
                Physical::BYTE_ARRAY,
                Some(LogicalType::String),
                Repetition::REQUIRED,
            )
        };
        let mut columns = vec![
            number("time_s", Physical::DOUBLE)?,
            number("tick", Physical::DOUBLE)?,
            column(
                "person",
                Physical::INT32,
                Some(LogicalType::integer(32, false)),
                Repetition::REQUIRED,
            )?,
            text("name")?,
        ];
        columns.extend([
            text("origin")?,
            text("state")?,
            number("views", Physical::INT32)?,
        ]);
        let unit = style.axes.unit.symbol();
        let mut numbers = Vec::new();
        for name in names(subject.keypoints) {
            numbers.extend(["x", "y", "z", "sigma"].map(|what| format!("{name}_{what}_{unit}")));
        }
        numbers.extend(ANGLE_NAMES.iter().enumerate().map(|(i, name)| {
            let unit = if is_translation(i) { "m" } else { "deg" };
            format!("{name}_{unit}")
        }));
        for name in &numbers {
            columns.push(column(name, Physical::FLOAT, None, Repetition::OPTIONAL)?);
        }
        let schema = Type::group_type_builder("poses")
            .with_fields(columns)
            .build()
            .map_err(failed)?;
        let properties = WriterProperties::builder()
            .set_created_by(format!("Farfield {}", env!("CARGO_PKG_VERSION")))
            .set_dictionary_enabled(false)
            .build();
        let out = SerializedFileWriter::new(out, Arc::new(schema), Arc::new(properties))
            .map_err(failed)?;
        let rows = Rows {
            numbers: vec![Vec::new(); numbers.len()],
            ..Rows::default()
        };
        Ok(Self { out, style, rows })
    }

    /// Adds a frame of a person.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn frame(&mut self, subject: &Subject<'_>, frame: &Frame) -> io::Result<()> {
        let Some((sample, _)) = &frame.pose else {
            return Ok(());
        };
        let Self { style, rows, .. } = self;
        rows.times_s.push(frame.time_s);
        rows.ticks.push(frame.position);
        rows.people.push(subject.id.cast_signed());
        rows.names.push(subject.name.into());
        rows.origins.push(origin(frame).into());
        rows.states.push(state(sample.state).into());
        rows.views.push(sample.views.cast_signed());
        let places = points(sample, subject.options.rest, subject.keypoints);
        let places = places.iter().flat_map(|point| match point {
            None => [None; 4],
            Some(point) => {
                let [x, y, z]: [f64; 3] = style.axes.point(&point.at_m).into();
                let sigma = point
                    .sigma_m
                    .map(|sigma_m| sigma_m * style.axes.unit.per_metre());
                [Some(x), Some(y), Some(z), sigma]
            }
        });
        let angles = sample.angles.iter().enumerate();
        let angles = angles.map(|(i, v)| {
            (!sample.is_unobserved(i)).then(|| {
                if is_translation(i) {
                    *v
                } else {
                    v.to_degrees()
                }
            })
        });
        for (column, value) in rows.numbers.iter_mut().zip(places.chain(angles)) {
            column.push(value.map(|v| v as f32));
        }
        if self.rows.times_s.len() == ROWS {
            self.write_rows()?;
        }
        Ok(())
    }

    fn write_rows(&mut self) -> io::Result<()> {
        let Self { out, rows, .. } = self;
        if rows.times_s.is_empty() {
            return Ok(());
        }
        let mut group = out.next_row_group().map_err(failed)?;
        write::<DoubleType, _>(&mut group, &rows.times_s, None)?;
        write::<DoubleType, _>(&mut group, &rows.ticks, None)?;
        write::<Int32Type, _>(&mut group, &rows.people, None)?;
        write::<ByteArrayType, _>(&mut group, &rows.names, None)?;
        write::<ByteArrayType, _>(&mut group, &rows.origins, None)?;
        write::<ByteArrayType, _>(&mut group, &rows.states, None)?;
        write::<Int32Type, _>(&mut group, &rows.views, None)?;
        for column in &rows.numbers {
            let known: Vec<f32> = column.iter().copied().flatten().collect();
            let levels: Vec<i16> = column.iter().map(|v| i16::from(v.is_some())).collect();
            write::<FloatType, _>(&mut group, &known, Some(&levels))?;
        }
        group.close().map_err(failed)?;
        let columns = rows.numbers.len();
        *rows = Rows {
            numbers: vec![Vec::new(); columns],
            ..Rows::default()
        };
        Ok(())
    }

    /// Writes the remaining rows and the footer.
    ///
    /// # Errors
    /// Errors of the writer.
    pub fn finish(mut self) -> io::Result<()> {
        self.write_rows()?;
        self.out.close().map(drop).map_err(failed)
    }
}

/// Writes the next column of a group.
fn write<T: DataType, W: Write + Send>(
    group: &mut SerializedRowGroupWriter<'_, W>,
    values: &[T::T],
    levels: Option<&[i16]>,
) -> io::Result<()> {
    let mut column = group
        .next_column()
        .map_err(failed)?
        .ok_or_else(|| io::Error::other("a column that the table does not have"))?;
    column
        .typed::<T>()
        .write_batch(values, levels, None)
        .map_err(failed)?;
    column.close().map_err(failed)
}
