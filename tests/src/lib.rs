//! An empty library: the tests that need several crates are in `tests/`.
