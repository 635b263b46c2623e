//! Exposure, gain and the other controls of a kernel camera.

use std::collections::BTreeMap;

use farfield_proto::toml_file::unknown_name;
use farfield_proto::venue::ControlValue;
use v4l::Device;
use v4l::control::{Control, Description, MenuItem, Type, Value};

/// Sets these controls. Menus and switches come first, because they enable others (such as manual
/// exposure).
///
/// # Errors
/// A message if a control does not exist, does not accept the value, or the camera refuses it; with
/// the accepted values.
pub(super) fn set(device: &Device, wanted: &BTreeMap<String, ControlValue>) -> Result<(), String> {
    if wanted.is_empty() {
        return Ok(());
    }
    let has = device.query_controls();
    let mut has = has.map_err(|problem| format!("`source.controls`: {problem}"))?;
    has.retain(|control| control.typ != Type::CtrlClass);
    let mut values = wanted
        .iter()
        .map(|(name, value)| value_of(&has, name, value))
        .collect::<Result<Vec<_>, _>>()?;
    values.sort_by_key(|(control, _, _)| !matches!(control.typ, Type::Boolean | Type::Menu));
    for (control, name, value) in values {
        let id = control.id;
        let set = device.set_control(Control { id, value });
        set.map_err(|problem| {
            format!("`source.controls.{name}`: the camera refuses it: {problem}")
        })?;
    }
    Ok(())
}

/// The control of that name, and the value in the kernel's form.
fn value_of<'a>(
    has: &'a [Description],
    name: &'a str,
    wanted: &ControlValue,
) -> Result<(&'a Description, &'a str, Value), String> {
    let names: Vec<_> = has
        .iter()
        .map(|control| plain_name(&control.name))
        .collect();
    let Some(at) = names.iter().position(|known| known == name) else {
        let known: Vec<_> = names.iter().map(String::as_str).collect();
        let problem = unknown_name("control", name, &known);
        return Err(format!("`source.controls`: {problem}"));
    };
    let control = &has[at];
    let value = match (wanted, control.typ) {
        (ControlValue::Switch(on), Type::Boolean) => Some(Value::Boolean(*on)),
        (ControlValue::Number(number), Type::Integer | Type::Integer64 | Type::Bitmask) => {
            (control.minimum..=control.maximum)
                .contains(number)
                .then_some(Value::Integer(*number))
        }
        (wanted, Type::Menu | Type::IntegerMenu) => items(control)
            .find(|(_, item)| is_item(item, wanted))
            .map(|(index, _)| Value::Integer(i64::from(*index))),
        _ => None,
    };
    let value = value.ok_or_else(|| {
        let found = match wanted {
            ControlValue::Switch(on) => on.to_string(),
            ControlValue::Number(number) => number.to_string(),
            ControlValue::Choice(choice) => format!("\"{choice}\""),
        };
        let expected = expected(control);
        format!("`source.controls.{name}`: found {found}, expected {expected}")
    })?;
    Ok((control, name, value))
}

fn items(control: &Description) -> impl Iterator<Item = &(u32, MenuItem)> {
    control.items.iter().flatten()
}

fn is_item(item: &MenuItem, wanted: &ControlValue) -> bool {
    match (item, wanted) {
        (MenuItem::Name(name), ControlValue::Choice(choice)) => name == choice,
        (MenuItem::Value(value), ControlValue::Number(number)) => value == number,
        _ => false,
    }
}

/// The accepted values of a control, in words.
fn expected(control: &Description) -> String {
    match control.typ {
        Type::Boolean => "true or false".to_owned(),
        Type::Menu | Type::IntegerMenu => {
            let one = |(_, item): &(u32, MenuItem)| match item {
                MenuItem::Name(name) => format!("\"{name}\""),
                MenuItem::Value(value) => value.to_string(),
            };
            let all: Vec<_> = items(control).map(one).collect();
            format!("one of {}", all.join(", "))
        }
        Type::Integer | Type::Integer64 | Type::Bitmask => {
            format!(
                "a whole number from {} to {}",
                control.minimum, control.maximum
            )
        }
        _ => "none: it cannot be set from a venue file".to_owned(),
    }
}

/// The name in the form of `v4l2-ctl`: lower-case letters and digits, with `_` between.
fn plain_name(name: &str) -> String {
    let words = name.split(|sign: char| !sign.is_ascii_alphanumeric());
    let words: Vec<_> = words.filter(|word| !word.is_empty()).collect();
    words.join("_").to_ascii_lowercase()
}

#[cfg(test)]
mod tests {
    use v4l::control::Flags;

    use super::*;

    fn description(name: &str, typ: Type, [minimum, maximum]: [i64; 2]) -> Description {
        Description {
            id: 7,
            typ,
            name: name.to_owned(),
            minimum,
            maximum,
            step: 1,
            default: 0,
            flags: Flags::empty(),
            items: None,
        }
    }

    #[test]
    fn values_are_checked_against_the_camera() {
        let mut mode = description("Auto Exposure", Type::Menu, [0, 3]);
        let name = |text: &str| MenuItem::Name(text.to_owned());
        mode.items = Some(vec![
            (1, name("Manual Mode")),
            (3, name("Aperture Priority Mode")),
        ]);
        let has = [
            description("Exposure Time, Absolute", Type::Integer, [1, 5000]),
            mode,
            description("White Balance, Automatic", Type::Boolean, [0, 1]),
        ];
        let of = |name, wanted| value_of(&has, name, &wanted).map(|(_, _, value)| value);
        assert_eq!(
            of("exposure_time_absolute", ControlValue::Number(20)),
            Ok(Value::Integer(20))
        );
        let manual = ControlValue::Choice("Manual Mode".to_owned());
        assert_eq!(of("auto_exposure", manual), Ok(Value::Integer(1)));
        assert_eq!(
            of("white_balance_automatic", ControlValue::Switch(false)),
            Ok(Value::Boolean(false))
        );
        for (name, wanted, problem) in [
            (
                "exposure_time_absolute",
                ControlValue::Number(0),
                "`source.controls.exposure_time_absolute`: found 0, expected a whole number from 1 to 5000",
            ),
            (
                "auto_exposure",
                ControlValue::Switch(false),
                "`source.controls.auto_exposure`: found false, expected one of \"Manual Mode\", \"Aperture Priority Mode\"",
            ),
            (
                "exposure_time",
                ControlValue::Number(20),
                "`source.controls`: unknown control `exposure_time`, did you mean `exposure_time_absolute`?",
            ),
        ] {
            assert_eq!(of(name, wanted), Err(problem.to_owned()));
        }
    }
}
