//! The table as a Parquet file.

use super::table::{DesignTable, TableEntry};
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
#[error("cannot write the table of designs: {0}")]
pub struct TableError(#[from] ParquetError);

/// A column: its name, and the value of each entry.
struct ParquetColumn<'a> {
    name: String,
    value: ColumnValues<'a>,
}

/// The value of an entry, where it has one.
type EntryValue<'a, T> = Box<dyn Fn(&TableEntry) -> Option<T> + 'a>;

enum ColumnValues<'a> {
    Number(EntryValue<'a, f64>),
    Text(EntryValue<'a, String>),
    Flag(Box<dyn Fn(&TableEntry) -> bool + 'a>),
}

/// The bytes of the file: a row for each design, `design` 0 being the scene as it is in its file.
///
/// # Errors
/// [`TableError`].
pub fn write_parquet_table(table: &DesignTable) -> Result<Vec<u8>, TableError> {
    let columns = build_parquet_columns_after_design_number(table);
    let mut fields = vec![Arc::new(
        Type::primitive_type_builder("design", Physical::INT64).with_repetition(Repetition::REQUIRED).build()?,
    )];
    for column in &columns {
        let (physical, converted) = match column.value {
            ColumnValues::Number(_) => (Physical::DOUBLE, ConvertedType::NONE),
            ColumnValues::Text(_) => (Physical::BYTE_ARRAY, ConvertedType::UTF8),
            ColumnValues::Flag(_) => (Physical::BOOLEAN, ConvertedType::NONE),
        };
        let repetition =
            if matches!(column.value, ColumnValues::Flag(_)) { Repetition::REQUIRED } else { Repetition::OPTIONAL };
        let field = Type::primitive_type_builder(&column.name, physical);
        fields.push(Arc::new(field.with_converted_type(converted).with_repetition(repetition).build()?));
    }
    let schema = Arc::new(Type::group_type_builder("study").with_fields(fields).build()?);
    let properties = WriterProperties::builder()
        .set_writer_version(WriterVersion::PARQUET_1_0)
        .set_compression(Compression::SNAPPY)
        .set_created_by(concat!("era-study ", env!("CARGO_PKG_VERSION")).into())
        .build();
    let entries: Vec<&TableEntry> = std::iter::once(&table.base).chain(&table.entries).collect();
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
                (ColumnWriter::DoubleColumnWriter(writer), ColumnValues::Number(of)) => {
                    let (values, there) =
                        present_values_and_presence_flags(part, |entry| of(entry).filter(|value| value.is_finite()));
                    writer.write_batch(&values, Some(&there), None)?;
                }
                (ColumnWriter::ByteArrayColumnWriter(writer), ColumnValues::Text(of)) => {
                    let (values, there) = present_values_and_presence_flags(part, |entry| {
                        of(entry).map(|text| ByteArray::from(text.as_str()))
                    });
                    writer.write_batch(&values, Some(&there), None)?;
                }
                (ColumnWriter::BoolColumnWriter(writer), ColumnValues::Flag(of)) => {
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

/// The values that are there, and for each entry 1 if its value is.
fn present_values_and_presence_flags<T>(
    entries: &[&TableEntry],
    value_of_entry: impl Fn(&TableEntry) -> Option<T>,
) -> (Vec<T>, Vec<i16>) {
    let all: Vec<Option<T>> = entries.iter().map(|entry| value_of_entry(entry)).collect();
    let there = all.iter().map(|value| i16::from(value.is_some())).collect();
    (all.into_iter().flatten().collect(), there)
}

/// A column of numbers.
fn number_column<'t>(name: String, value_of_entry: impl Fn(&TableEntry) -> Option<f64> + 't) -> ParquetColumn<'t> {
    ParquetColumn { name, value: ColumnValues::Number(Box::new(value_of_entry)) }
}

/// All columns of the file after `design`.
fn build_parquet_columns_after_design_number(table: &DesignTable) -> Vec<ParquetColumn<'_>> {
    let mut columns = vec![
        ParquetColumn {
            name: "status".into(),
            value: ColumnValues::Text(Box::new(|entry| Some(entry.status.name().into()))),
        },
        ParquetColumn { name: "reason".into(), value: ColumnValues::Text(Box::new(|entry| entry.reason.clone())) },
        ParquetColumn { name: "on_front".into(), value: ColumnValues::Flag(Box::new(|entry| entry.is_on_front)) },
    ];
    for column in &table.columns {
        columns.push(match column.words {
            Some(_) => ParquetColumn {
                name: column.name.clone(),
                value: ColumnValues::Text(Box::new(move |entry| {
                    column.text_in_design_unless_scene_value_kept(&entry.row.design)
                })),
            },
            None => number_column(column.name.clone(), move |entry| {
                column.number_or_choice_index_in_design_unless_scene_value_kept(&entry.row.design)
            }),
        });
    }
    for (k, wanted) in table.figures.iter().enumerate() {
        let name = wanted.column_name();
        columns
            .push(number_column(name.clone(), move |entry| entry.row.figures_unless_failed()?.values.get(k).copied()));
        if table.has_ends {
            columns.push(number_column(format!("{name}_low"), move |entry| {
                entry.row.least_and_most_of_figure_over_samples_unless_failed(k).map(|(low, _)| low)
            }));
            columns.push(number_column(format!("{name}_high"), move |entry| {
                entry.row.least_and_most_of_figure_over_samples_unless_failed(k).map(|(_, high)| high)
            }));
        }
    }
    if table.has_weakest_places() {
        for (k, name) in ["weakest_x_mm", "weakest_y_mm"].into_iter().enumerate() {
            columns.push(number_column(name.into(), move |entry| {
                entry.row.figures_unless_failed()?.weakest_mm.map(|at| at[k])
            }));
        }
    }
    columns
}
