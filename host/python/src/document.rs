//! A scene's document: from Python's mappings to TOML and back, and changed copies of it.

use crate::errors::Raised;
use era_study::spec::TABLE_NAMES;
use pyo3::exceptions::PyTypeError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyList, PyMapping, PySequence, PyString};
use toml::{Table, Value};

/// A document from keywords; those that are `None` are left out. A scene file's version is added.
pub fn scene_table_with_version_from_keywords(keywords: &Bound<'_, PyDict>) -> PyResult<Table> {
    let mut table = Table::new();
    table.insert("version".into(), Value::Integer(1));
    for (key, value) in keywords {
        if let Some(value) = toml_value_from_python_unless_none(&value)? {
            table.insert(key.extract()?, value);
        }
    }
    Ok(table)
}

/// A value; nothing for `None`.
fn toml_value_from_python_unless_none(value: &Bound<'_, PyAny>) -> PyResult<Option<Value>> {
    if value.is_none() {
        return Ok(None);
    }
    let found = if let Ok(flag) = value.cast::<PyBool>() {
        Value::Boolean(flag.is_true())
    } else if let Ok(text) = value.cast::<PyString>() {
        Value::String(text.extract()?)
    } else if value.is_instance_of::<PyInt>() {
        Value::Integer(value.extract()?)
    } else if value.is_instance_of::<PyFloat>() {
        Value::Float(value.extract()?)
    } else if let Ok(mapping) = value.cast::<PyMapping>() {
        let mut table = Table::new();
        for (key, value) in mapping_entries(mapping)? {
            if let Some(value) = toml_value_from_python_unless_none(&value)? {
                table.insert(key.extract()?, value);
            }
        }
        Value::Table(table)
    } else if let Ok(sequence) = value.cast::<PySequence>() {
        let mut list = Vec::new();
        for entry in sequence.try_iter()? {
            list.extend(toml_value_from_python_unless_none(&entry?)?);
        }
        Value::Array(list)
    } else if value.hasattr("dtype")? && value.hasattr("tolist")? {
        return toml_from_numpy_unless_holding_none(value);
    } else if let Ok(whole) = value.extract::<i64>() {
        // NumPy's whole numbers, which are none of Python's.
        Value::Integer(whole)
    } else if let Ok(number) = value.extract::<f64>() {
        Value::Float(number)
    } else {
        let kind = value.get_type().name()?;
        return Err(PyTypeError::new_err(format!("a scene cannot contain a value of the type {kind}: {value}")));
    };
    Ok(Some(found))
}

/// The value of NumPy's arrays and numbers: that of the list, or the number, that they are of.
fn toml_from_numpy_unless_holding_none(value: &Bound<'_, PyAny>) -> PyResult<Option<Value>> {
    // Below a mask is nothing that was measured, and a list would leave it out without a word.
    if value.py().import("numpy")?.getattr("ma")?.call_method1("is_masked", (value,))?.extract()? {
        return Err(PyTypeError::new_err(
            "a scene cannot contain masked entries: remove masked entries from an array with compressed()",
        ));
    }
    let plain = value.call_method0("tolist")?;
    if plain.hasattr("dtype")? {
        // Numbers wider than Python's stay what they are.
        return Ok(Some(Value::Float(plain.extract()?)));
    }
    toml_value_from_python_unless_none(&plain)
}

fn mapping_entries<'py>(mapping: &Bound<'py, PyMapping>) -> PyResult<Vec<(Bound<'py, PyAny>, Bound<'py, PyAny>)>> {
    mapping.items()?.iter().map(|entry| entry.extract()).collect()
}

/// Changes `table` by keywords: mappings change what they name, `None` takes away, everything else replaces.
pub fn merge_keywords_into_table_removing_keys_set_to_none(
    table: &mut Table,
    keywords: &Bound<'_, PyDict>,
) -> PyResult<()> {
    for (key, value) in keywords {
        merge_mapping_into_or_replace_or_remove_value_of_key(table, &key.extract::<String>()?, &value)?;
    }
    Ok(())
}

fn merge_mapping_into_or_replace_or_remove_value_of_key(
    table: &mut Table,
    key: &str,
    value: &Bound<'_, PyAny>,
) -> PyResult<()> {
    match (table.get_mut(key), value.cast::<PyMapping>()) {
        (Some(Value::Table(inner)), Ok(mapping)) => {
            for (key, value) in mapping_entries(mapping)? {
                merge_mapping_into_or_replace_or_remove_value_of_key(inner, &key.extract::<String>()?, &value)?;
            }
        }
        (Some(Value::Array(list)), Ok(mapping)) => change_or_remove_list_entries_by_index_or_name(key, list, mapping)?,
        _ => match toml_value_from_python_unless_none(value)? {
            Some(value) => {
                table.insert(key.to_owned(), value);
            }
            None => {
                table.remove(key);
            }
        },
    }
    Ok(())
}

/// Changes entries of a list, each by its index from 0 (or from -1 for the last) or by its name.
fn change_or_remove_list_entries_by_index_or_name(
    key: &str,
    list: &mut Vec<Value>,
    mapping: &Bound<'_, PyMapping>,
) -> PyResult<()> {
    let mut gone = Vec::new();
    for (which, value) in mapping_entries(mapping)? {
        let at = index_of_list_entry_by_number_or_name(key, list, &which)?;
        match (list.get_mut(at), value.cast::<PyMapping>()) {
            (Some(Value::Table(entry)), Ok(changes)) => {
                for (key, value) in mapping_entries(changes)? {
                    merge_mapping_into_or_replace_or_remove_value_of_key(entry, &key.extract::<String>()?, &value)?;
                }
            }
            (Some(slot), _) => match toml_value_from_python_unless_none(&value)? {
                Some(value) => *slot = value,
                None => gone.push(at),
            },
            (None, _) => {}
        }
    }
    // From the end, so that the places of those before stay.
    gone.sort_unstable();
    gone.into_iter().rev().for_each(|at| drop(list.remove(at)));
    Ok(())
}

/// Which entry of the list `key` is meant.
fn index_of_list_entry_by_number_or_name(key: &str, list: &[Value], which: &Bound<'_, PyAny>) -> PyResult<usize> {
    let count = list.len();
    if let Ok(index) = which.extract::<i64>() {
        let from_end = i64::try_from(count).unwrap_or(i64::MAX).saturating_add(index);
        let at = usize::try_from(if index < 0 { from_end } else { index }).ok().filter(|at| *at < count);
        #[expect(clippy::cast_precision_loss, reason = "to be shown")]
        let wrong = || {
            Raised::wrong_argument(
                key,
                index as f64,
                format!("the index of one of the {count} entries, counted from 0"),
            )
        };
        return at.ok_or_else(|| wrong().into());
    }
    let wanted: String = which.extract()?;
    let named = TABLE_NAMES.iter().find(|(of, _)| *of == key).map(|(_, name)| *name);
    let name_of = |entry: &Value| named.and_then(|name| entry.get(name)?.as_str().map(str::to_owned));
    let names: Vec<String> = list.iter().filter_map(name_of).collect();
    let found = list.iter().position(|entry| name_of(entry).as_ref() == Some(&wanted));
    let allowed = match named {
        Some(name) => format!("an index (counted from 0) or the {name} of an entry (one of: {})", names.join(", ")),
        None => String::from("an index, counted from 0, because the entries have no names"),
    };
    found.ok_or_else(|| Raised::wrong_argument(key, wanted.as_str(), allowed).into())
}

/// The document as Python has it.
pub fn table_to_python_dict<'py>(py: Python<'py>, table: &Table) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    for (key, value) in table {
        dict.set_item(key, toml_value_to_python(py, value)?)?;
    }
    Ok(dict)
}

fn toml_value_to_python<'py>(py: Python<'py>, value: &Value) -> PyResult<Bound<'py, PyAny>> {
    Ok(match value {
        Value::String(text) => text.into_pyobject(py)?.into_any(),
        Value::Integer(whole) => whole.into_pyobject(py)?.into_any(),
        Value::Float(number) => number.into_pyobject(py)?.into_any(),
        Value::Boolean(flag) => flag.into_pyobject(py)?.to_owned().into_any(),
        Value::Datetime(time) => time.to_string().into_pyobject(py)?.into_any(),
        Value::Array(list) => {
            let list = list.iter().map(|entry| toml_value_to_python(py, entry)).collect::<PyResult<Vec<_>>>()?;
            PyList::new(py, list)?.into_any()
        }
        Value::Table(table) => table_to_python_dict(py, table)?.into_any(),
    })
}
