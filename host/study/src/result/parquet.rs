//! The table as a Parquet file.

use super::table::{Entry, Table};
use parquet::basic::{Compression, ConvertedType, Repetition, Type as Physical};
use parquet::column::writer::ColumnWriter;
use parquet::data_type::ByteArray;
use parquet::errors::ParquetError;
use parquet::file::properties::{WriterProperties, WriterVersion};
use parquet::file::writer::SerializedFileWriter;
use parquet::schema::types::Type;
use std::sync::Arc;

/// Rows that are compressed together.
const GROUP: usize = 65_536;

/// A table that cannot be written as Parquet.
#[derive(Debug, thiserror::Error)]
#[error("cannot write the table: {0}")]
pub struct TableError(#[from] ParquetError);

/// A column: its name, and the value of each entry.
struct Written<'a> {
    name: String,
    value: Of<'a>,
}

/// The value of an entry, where it has one.
type Get<'a, T> = Box<dyn Fn(&Entry) -> Option<T> + 'a>;

enum Of<'a> {
    Number(Get<'a, f64>),
    Text(Get<'a, String>),
    Flag(Box<dyn Fn(&Entry) -> bool + 'a>),
}

/// The bytes of the file: a row for each design, `design` 0 being the scene as it is in its file.
///
/// # Errors
/// [`TableError`].
pub fn write(table: &Table) -> Result<Vec<u8>, TableError> {
    let columns = columns(table);
    let mut fields = vec![Arc::new(
        Type::primitive_type_builder("design", Physical::INT64).with_repetition(Repetition::REQUIRED).build()?,
    )];
    for column in &columns {
        let (physical, converted) = match column.value {
            Of::Number(_) => (Physical::DOUBLE, ConvertedType::NONE),
            Of::Text(_) => (Physical::BYTE_ARRAY, ConvertedType::UTF8),
            Of::Flag(_) => (Physical::BOOLEAN, ConvertedType::NONE),
        };
        let repetition = if matches!(column.value, Of::Flag(_)) { Repetition::REQUIRED } else { Repetition::OPTIONAL };
        let field = Type::primitive_type_builder(&column.name, physical);
        fields.push(Arc::new(field.with_converted_type(converted).with_repetition(repetition).build()?));
    }
    let schema = Arc::new(Type::group_type_builder("study").with_fields(fields).build()?);
    let properties = WriterProperties::builder()
        .set_writer_version(WriterVersion::PARQUET_1_0)
        .set_compression(Compression::SNAPPY)
        .set_created_by(concat!("era-study ", env!("CARGO_PKG_VERSION")).into())
        .build();
    let entries: Vec<&Entry> = std::iter::once(&table.base).chain(&table.entries).collect();
    let mut bytes = Vec::new();
    let mut file = SerializedFileWriter::new(&mut bytes, schema, Arc::new(properties))?;
    for (group, part) in entries.chunks(GROUP).enumerate() {
        let mut rows = file.next_row_group()?;
        let first = i64::try_from(group * GROUP).unwrap_or(i64::MAX);
        if let Some(mut column) = rows.next_column()? {
            if let ColumnWriter::Int64ColumnWriter(writer) = column.untyped() {
                let numbers: Vec<i64> = (first..).take(part.len()).collect();
                writer.write_batch(&numbers, None, None)?;
            }
            column.close()?;
        }
        for own in &columns {
            let Some(mut column) = rows.next_column()? else { break };
            match (column.untyped(), &own.value) {
                (ColumnWriter::DoubleColumnWriter(writer), Of::Number(of)) => {
                    let (values, there) = optional(part, |entry| of(entry).filter(|value| value.is_finite()));
                    writer.write_batch(&values, Some(&there), None)?;
                }
                (ColumnWriter::ByteArrayColumnWriter(writer), Of::Text(of)) => {
                    let (values, there) = optional(part, |entry| of(entry).map(|text| ByteArray::from(text.as_str())));
                    writer.write_batch(&values, Some(&there), None)?;
                }
                (ColumnWriter::BoolColumnWriter(writer), Of::Flag(of)) => {
                    let values: Vec<bool> = part.iter().map(|entry| of(entry)).collect();
                    writer.write_batch(&values, None, None)?;
                }
                _ => {}
            }
            column.close()?;
        }
        rows.close()?;
    }
    file.close()?;
    Ok(bytes)
}

/// The values that are there, and for each entry 1 if its is.
fn optional<T>(entries: &[&Entry], of: impl Fn(&Entry) -> Option<T>) -> (Vec<T>, Vec<i16>) {
    let all: Vec<Option<T>> = entries.iter().map(|entry| of(entry)).collect();
    let there = all.iter().map(|value| i16::from(value.is_some())).collect();
    (all.into_iter().flatten().collect(), there)
}

fn number<'t>(name: String, of: impl Fn(&Entry) -> Option<f64> + 't) -> Written<'t> {
    Written { name, value: Of::Number(Box::new(of)) }
}

fn columns(table: &Table) -> Vec<Written<'_>> {
    let mut columns = vec![
        Written { name: "status".into(), value: Of::Text(Box::new(|entry| Some(entry.status.name().into()))) },
        Written { name: "reason".into(), value: Of::Text(Box::new(|entry| entry.reason.clone())) },
        Written { name: "on_front".into(), value: Of::Flag(Box::new(|entry| entry.is_on_front)) },
    ];
    for column in &table.columns {
        columns.push(match column.words {
            Some(_) => Written {
                name: column.name.clone(),
                value: Of::Text(Box::new(move |entry| column.text(&entry.row.design))),
            },
            None => number(column.name.clone(), move |entry| column.number(&entry.row.design)),
        });
    }
    for (k, wanted) in table.figures.iter().enumerate() {
        let name = wanted.column();
        columns.push(number(name.clone(), move |entry| entry.row.figures()?.values.get(k).copied()));
        if table.has_ends {
            columns.push(number(format!("{name}_low"), move |entry| entry.row.ends(k).map(|(low, _)| low)));
            columns.push(number(format!("{name}_high"), move |entry| entry.row.ends(k).map(|(_, high)| high)));
        }
    }
    if table.has_weakest() {
        for (k, name) in ["weakest_x_mm", "weakest_y_mm"].into_iter().enumerate() {
            columns.push(number(name.into(), move |entry| entry.row.figures()?.weakest_mm.map(|at| at[k])));
        }
    }
    columns
}
