//! The macro that generates everything about the parameters from one list.

/// From one list of parameters it generates: a documented struct per table with its defaults,
/// [`super::Parameters`], the structs that serde reads from a venue file (the users' tables, and
/// those under `[tuning]`), the descriptions [`super::PARAMETERS`], and every parameter's value in
/// the same order.
macro_rules! declare_parameters {
    ($(
        #[doc = $about:literal]
        $table:ident: $Table:ident {
            $(user $User:ident { $(
                $(#[doc = $user_doc:literal])+
                $user:ident: $user_kind:ty = $user_default:expr
                    $(=> $user_example:literal or $user_unset:literal)?
                    $(, $user_unit:literal, $user_min:literal to $user_max:literal)?;
            )+ })?
            $(tuning $Tuning:ident { $(
                $(#[doc = $tuning_doc:literal])+
                $tuning:ident: $tuning_kind:ty = $tuning_default:expr
                    $(, $tuning_unit:literal, $tuning_min:literal to $tuning_max:literal)?;
            )+ })?
        }
    )+) => {
        $(
            #[doc = concat!("The parameters of `", stringify!($table), "`:")]
            #[doc = $about]
            #[derive(Debug, Clone, PartialEq)]
            pub struct $Table {
                $($(
                    $(#[doc = $user_doc])+
                    #[doc = ""]
                    #[doc = concat!(
                        "Default: `", stringify!($user_default), "`"
                        $(, " (", $user_unset, ")")?
                        $(, ", unit: `", $user_unit, "`, from ", $user_min, " to ", $user_max)?
                        , "."
                    )]
                    pub $user: $user_kind,
                )+)?
                $($(
                    $(#[doc = $tuning_doc])+
                    #[doc = ""]
                    #[doc = concat!(
                        "Default: `", stringify!($tuning_default), "`"
                        $(, ", unit: `", $tuning_unit, "`, from ", $tuning_min, " to ", $tuning_max)?
                        , "."
                    )]
                    pub $tuning: $tuning_kind,
                )+)?
            }

            impl Default for $Table {
                fn default() -> Self {
                    Self {
                        $($($user: $user_default,)+)?
                        $($($tuning: $tuning_default,)+)?
                    }
                }
            }

            $(declare_parameters!(@read $User { $($user: $user_kind = $user_default,)+ });)?
            $(declare_parameters!(@read $Tuning { $($tuning: $tuning_kind = $tuning_default,)+ });)?
        )+

        /// All parameters, by their tables.
        #[derive(Debug, Clone, PartialEq, Default)]
        pub struct Parameters {
            $(#[doc = $about] pub $table: $Table,)+
        }

        /// `[tuning]` in a venue file.
        #[derive(Debug, Default, serde::Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub(in crate::venue) struct TuningTables {
            $($(pub(in crate::venue) $table: $Tuning,)?)+
        }

        /// The users' tables and `[tuning]` in a venue file.
        #[derive(Debug, Default, serde::Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub(in crate::venue) struct ParameterTables {
            $($(pub(in crate::venue) $table: $User,)?)+
            pub(in crate::venue) tuning: TuningTables,
        }

        impl From<ParameterTables> for Parameters {
            fn from(tables: ParameterTables) -> Self {
                Self {
                    $($table: $Table {
                        $($($user: tables.$table.$user,)+)?
                        $($($tuning: tables.tuning.$table.$tuning,)+)?
                    },)+
                }
            }
        }

        impl Parameters {
            /// The values in the order of [`PARAMETERS`].
            pub(super) fn in_order(&self) -> Vec<Option<toml::Value>> {
                use super::choices::ParameterValue as _;
                vec![$(
                    $($(self.$table.$user.to_toml(),)+)?
                    $($(self.$table.$tuning.to_toml(),)+)?
                )+]
            }
        }

        /// Every parameter, table by table.
        pub static PARAMETERS: &[super::Parameter] = &[$(
            $($(super::Parameter {
                table: stringify!($table),
                name: stringify!($user),
                audience: super::Audience::User,
                sentence: concat!($($user_doc),+).trim_ascii(),
                range: declare_parameters!(@range $($user_unit, $user_min, $user_max)?),
                words: <$user_kind as super::choices::ParameterValue>::WORDS,
                unset: declare_parameters!(@unset $($user_example, $user_unset)?),
            },)+)?
            $($(super::Parameter {
                table: stringify!($table),
                name: stringify!($tuning),
                audience: super::Audience::Tuning,
                sentence: concat!($($tuning_doc),+).trim_ascii(),
                range: declare_parameters!(@range $($tuning_unit, $tuning_min, $tuning_max)?),
                words: <$tuning_kind as super::choices::ParameterValue>::WORDS,
                unset: None,
            },)+)?
        )+];

        /// Every table, with its subject.
        pub static TABLES: &[(&str, &str)] = &[$((stringify!($table), $about.trim_ascii()),)+];
    };
    (@read $Name:ident { $($field:ident: $kind:ty = $default:expr,)+ }) => {
        #[derive(Debug, serde::Deserialize)]
        #[serde(deny_unknown_fields, default)]
        pub(in crate::venue) struct $Name {
            $($field: $kind,)+
        }

        impl Default for $Name {
            fn default() -> Self {
                Self { $($field: $default,)+ }
            }
        }
    };
    (@range) => { None };
    (@range $unit:literal, $min:literal, $max:literal) => {
        Some(super::Range { unit: $unit, min: $min, max: $max })
    };
    (@unset) => { None };
    (@unset $example:literal, $words:literal) => {
        Some(super::Unset { example: $example, words: $words })
    };
}

pub(super) use declare_parameters;
