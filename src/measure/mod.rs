//! What a result costs and how far it is from the truth.
