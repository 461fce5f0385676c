#!/usr/bin/env bash
# Tests the npm and PyPI packages, built, installed from the packed files and run against a probe; the page's Rust text; and the C# sources of the Unity package, compiled and run.
#
#   tests/packages/check.sh HEMILUX
#
# Needs Node.js 20, npm, Python 3.10 with venv, and their registries for the first run; for C# Mono's mcs; cargo. If a tool is missing, a
# line names it and its part is skipped; with HEMILUX_RIG set the check fails.
set -euo pipefail
here=$(cd "$(dirname "$0")" && pwd)
clients=$here/../../board/clients
program=$(realpath "$1")
cache=${XDG_CACHE_HOME:-$HOME/.cache}/hemilux-packages
work=$(mktemp -d)
mkdir -p "$cache"

"$program" --listen 127.0.0.1:0 --lights 16 >"$work/serving" 2>"$work/log" &
probe=$!
trap 'kill $probe 2>/dev/null || true; rm -rf "$work"' EXIT
for _ in $(seq 100); do grep -q http "$work/serving" && break; sleep 0.1; done
address=$(grep -oE 'http://[^/ ]+' "$work/serving" | head -1)
failed=0
check() { if eval "$2"; then echo "  ok   $1"; else echo "  FAIL $1"; failed=1; fi; }
missing() { echo "  skipped: $1 is not installed"; [ -z "${HEMILUX_RIG:-}" ] || failed=1; }
# Checks that the command prints one line on stderr that names the address, and exits with a status other than 0.
refuses() {
    local lines
    if timeout 20 "${@:2}" >/dev/null 2>"$work/refusal"; then return 1; fi
    lines=$(wc -l <"$work/refusal")
    [ "$lines" = 1 ] && grep -q "$1" "$work/refusal"
}

echo "npm:"
node "$clients/npm/build.mjs" "$work" >"$work/packed"
mkdir "$work/app"
cp "$here"/app/* "$work/app"
npm install --silent --no-audit --no-fund --prefix "$work/app" "$(cat "$work/packed")" esbuild@0.25.9 typescript@5.9.2 three@0.180.0 @types/three@0.180.0
cd "$work/app"
check "Node.js: sets, ids and states" 'node node.mjs "$address"'
check "the example prints sets" '[ "$(timeout 20 node node_modules/hemilux/examples/lights.mjs "$address" 3 | grep -c ^frame)" = 3 ]'
check "the example refuses what is no address in one line" 'refuses nonsense node node_modules/hemilux/examples/lights.mjs nonsense'
check "TypeScript: the types hold" 'npx tsc --noEmit --strict --target es2022 --module nodenext --lib es2022,dom --skipLibCheck types.mts'
check "a bundler: the bundle runs" 'npx esbuild node.mjs --bundle --platform=node --format=esm --log-level=error --outfile=bundle.mjs && node bundle.mjs "$address"'
check "a bundler for browsers: three.js lights" 'npx esbuild three.mjs --bundle --format=esm --log-level=error --outfile=three-bundle.mjs && node three-bundle.mjs "$address"'
cd "$here"

echo "PyPI:"
python3 -m venv "$work/build"
"$work/build/bin/pip" install --quiet --disable-pip-version-check build==1.3.0
cp -r "$clients/python" "$work/python"
"$work/build/bin/python" -m build --outdir "$work/dist" "$work/python" >"$work/build.log" 2>&1 || { tail -5 "$work/build.log"; exit 1; }
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet --disable-pip-version-check "$work"/dist/*.whl mypy==1.18.2
check "asyncio and blocking calls" '"$work/venv/bin/python" "$here/package.py" "$address"'
check "the types hold" '(cd "$work" && venv/bin/mypy --strict --no-error-summary -p hemilux >mypy.log || { cat mypy.log; false; })'
check "the command prints sets" '[ "$("$work/venv/bin/hemilux-lights" "$address" --lights 2 --frames 3 | grep -c ^frame)" = 3 ]'
check "the command names a wrong address in one line" 'refuses 127.0.0.1:9 "$work/venv/bin/hemilux-lights" http://127.0.0.1:9 --timeout 1'
check "the command refuses what is no address in one line" 'refuses "expected http://HOST:PORT" "$work/venv/bin/hemilux-lights" ftp://x'
check "the example script names a wrong address" '(timeout 3 python3 "$clients/../examples/lights.py" http://127.0.0.1:9 1 2>&1 || true) | grep -q "no light set"'

echo "Rust:"
mkdir -p "$work/rust/src"
cp "$clients/../src/server/page/snippets.js" "$work/snippets.mjs"
node --input-type=module -e 'import(process.argv[1]).then(page => process.stdout.write(page.SNIPPETS.Rust[1](process.argv[2])))' "$work/snippets.mjs" "$address" >"$work/rust/src/main.rs"
cat >"$work/rust/Cargo.toml" <<TOML
[package]
name = "snippet"
version = "0.0.0"
edition = "2024"

[dependencies]
hemilux = { path = "$(realpath "$clients/..")", default-features = false, features = ["client"] }

[workspace]
TOML
cp "$here/../../Cargo.lock" "$work/rust/Cargo.lock"
check "the page's program text compiles" 'CARGO_TARGET_DIR="$cache/rust" cargo build --quiet --manifest-path "$work/rust/Cargo.toml"'
check "it prints sets" '[ "$(timeout 3 "$cache/rust/debug/snippet" | grep -cE "^frame [0-9]+: [0-9]+ lights$")" -ge 3 ]'

echo "Unity:"
sources=("$clients"/unity/Runtime/LightSet.cs "$clients"/unity/Runtime/Json.cs "$clients"/unity/Runtime/Events.cs "$here/unity.cs")
curl -s "$address/v1/lights?coordinates=unity&ambient=1" >"$work/unity.json"
curl -s "$address/v1/lights?coordinates=probe&ambient=1&after=0" >"$work/probe.json"
if command -v mcs >/dev/null && command -v mono >/dev/null; then
    check "C#: parser, axes, stream" 'mcs -langversion:7.2 -out:"$work/unity.exe" "${sources[@]}" && mono "$work/unity.exe" "$work/unity.json" "$address"'
else
    missing "mcs (Debian: mono-mcs, mono-runtime)"
fi
check "package.json: the UPM layout" 'python3 "$here/upm.py" "$clients/unity"'

echo "packages: $([ $failed = 0 ] && echo passed || echo failed)"
exit $failed
