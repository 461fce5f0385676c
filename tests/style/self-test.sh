#!/usr/bin/env bash
# Checks that check.sh finds one violation of each rule in a tree that has one of each, and none in a tree without violations.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cp -r "$here" "$work/style"
printf '# none\n' >"$work/style/people.txt"
mkdir "$work/tree"
cd "$work/tree"
git init -q
printf '//! Short.\nfn short() {}\n// "{ fn" is a string.\n' >short.rs
printf '{\n"a": 1\n}\n' >openapi.json
mkdir -p crate/src
printf 'mod a;\nmod b;\npub use a::A;\n' >crate/src/lib.rs
printf 'use crate::b::B;\npub struct A(B);\n' >crate/src/a.rs
printf '//! Not [`crate::A`].\npub struct B;\n#[cfg(test)]\nmod tests {\n    use crate::a::A;\n}\n' >crate/src/b.rs
git add .
"$work/style/check.sh" . >"$work/clean" || { cat "$work/clean"; echo "self-test: found violations in a clean tree, expected none" >&2; exit 1; }

printf '/// Wakes who waits.\nfn word() {}\n' >word.rs
{ echo 'fn long() {'; printf '    f("{"); // %s\n' $(seq 79); echo '}'; } >long.rs
{ printf '// line %s\n' $(seq 401); echo '#[cfg(test)]'; echo 'mod tests {'; echo '}'; } >file.rs
printf '{"a": "%0160d"}\n' 0 >openapi.json
touch plugin.so
printf 'use crate::{A as Other, b};\n' >>crate/src/b.rs
git add .
if "$work/style/check.sh" . >"$work/found"; then
    echo "self-test: found status 0 for a tree with violations, expected 1" >&2
    exit 1
fi
for expected in "word.rs:1: found 'who'" 'long.rs:1: found 81 lines' 'file.rs: found 401 lines' 'openapi.json:1: found 169' 'plugin.so: found' 'crate/src: found an import cycle, expected none: a imports b (crate/src/a.rs:1), b imports a (crate/src/b.rs:7)' 'style: 6 violations'; do
    grep -qF "$expected" "$work/found" || { cat "$work/found"; echo "self-test: found the above, expected '$expected'" >&2; exit 1; }
done
