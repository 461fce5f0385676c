//! An empty library: the tests of several crates are in `tests/`.
