//! The first program of the README equals the example, so that the documentation tests run the program of `cargo run --example`.

#[test]
fn first_code_block_of_the_readme_equals_the_example() {
    let readme = include_str!("../../README.md");
    let example = include_str!("../../examples/burst_to_lights.rs");
    let code = readme.split("```rust\n").nth(1).and_then(|rest| rest.split("```\n").next());
    assert_eq!(code, Some(example));
    assert!(example.lines().count() <= 60, "{} lines", example.lines().count());
    let paths = example.matches("hemilux_core::").count();
    let names = example.split("use hemilux_core::{").nth(1).and_then(|rest| rest.split('}').next());
    let names = names.map_or(0, |list| list.split(',').count());
    assert!(paths == 1 && names <= 6, "{paths} statements with {names} names, expected one with at most 6");
}
