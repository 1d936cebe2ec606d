//! Choices that are written as words: in the database, in requests, in answers.

/// An enum of words, each with its text: `as_str`, `FromStr`, serde, and `read` for what the database holds.
macro_rules! text_enum {
    (
        $(#[$about:meta])* pub enum $name:ident { $( $(#[$about_one:meta])* $one:ident = $text:literal, )+ }
    ) => {
        $(#[$about])*
        #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, serde::Serialize, serde::Deserialize)]
        pub enum $name { $( $(#[$about_one])* #[serde(rename = $text)] $one, )+ }

        impl $name {
            /// The word.
            pub fn as_str(self) -> &'static str {
                match self { $( $name::$one => $text, )+ }
            }

            /// Reads what the database holds.
            pub(crate) fn read(text: &str) -> Result<$name, crate::store::StoreError> {
                text.parse().map_err(|problem| crate::store::StoreError::Damaged { what: stringify!($name), problem })
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(self.as_str())
            }
        }

        impl std::str::FromStr for $name {
            type Err = String;

            fn from_str(text: &str) -> Result<$name, String> {
                match text {
                    $( $text => Ok($name::$one), )+
                    _ => Err(format!("{text:?} is none of {}", [$( $text ),+].join(", "))),
                }
            }
        }
    };
}
pub(crate) use text_enum;
