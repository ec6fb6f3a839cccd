//! What replies say about a target: its identities and its height.

pub(super) mod height;
pub(super) mod identity;
