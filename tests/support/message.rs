//! What an error says.

use std::error::Error;

/// What is wrong, with all its causes.
pub fn whole_message(error: &dyn Error) -> String {
    let mut message = error.to_string();
    let mut source = error.source();
    while let Some(cause) = source {
        message = format!("{message}: {cause}");
        source = cause.source();
    }
    message
}
