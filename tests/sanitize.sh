#!/usr/bin/env bash
# What takes too long for every change: native kernels and loader under the address sanitizer (about eight minutes on two
# cores), the C example under the sanitizers of the C compiler, and every f32 through the elementary functions.
set -euo pipefail
cd "$(dirname "$0")/.."

# The sanitizer of rustc is unstable: this lets a stable compiler have it.
export RUSTC_BOOTSTRAP=1
target=$(rustc -vV | sed -n 's/^host: //p')
RUSTFLAGS="-Zsanitizer=address" cargo test --release --target "$target" --target-dir target/sanitized \
  -p bake-runtime --test native --test loader

cargo build --release -p bake-capi
mkdir -p target/sanitized
cc -std=c99 -g -fsanitize=address,undefined -fno-sanitize-recover -I runtime/include runtime/capi/examples/sample.c \
  -o target/sanitized/sample -L target/release -lbake -Wl,-rpath,"$PWD/target/release"
for material in vase conductor; do
  target/sanitized/sample "scenes/materials/$material" > /dev/null
done

cargo test --release -p bake-runtime --lib -- --ignored
