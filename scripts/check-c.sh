#!/usr/bin/env bash
# Proves the C side: builds everything with CMake, runs its programs, compares the binary interface, compiles headers
# and examples by gcc and clang in several standards, installs, and builds consumers from the installed tree by
# find_package and by pkg-config. Needs cmake, gcc, g++, clang, pkg-config and abigail-tools.
#
#     scripts/check-c.sh [BUILD_DIRECTORY [LIBRARIES]]
#
# LIBRARIES: folder of static libraries that cargo has built, such as target/debug; otherwise it builds a release.
set -euo pipefail
cd "$(dirname "$0")/.."
build=${1:-build}
built=${2:+$(cd "$2" && pwd)}
mkdir -p "$build"
build=$(cd "$build" && pwd)
target=${CARGO_TARGET_DIR:-$PWD/target}

# Programs that keep the library's clock run in stepped time, which no load of the machine disturbs.
stepped=sim:$PWD/capi/tests/stepped_echo.toml

# The static libraries in their order.
static=("$build/libecan_igh_host.a" "$build/libecan_mcan_host.a" -lpthread -ldl -lm)

say() { printf -- '-- %s\n' "$1"; }

say "CMake"
cmake -S . -B "$build" -DECAN_CARGO_TARGET_DIR="$target" "-DECAN_BUILT_LIBRARIES=$built" \
    "-DCMAKE_CROSSCOMPILING_EMULATOR=$PWD/capi/tests/runner.sh" >"$build/configure.log" ||
    { cat "$build/configure.log"; exit 1; }
cmake --build "$build" --parallel 2
ctest --test-dir "$build" --output-on-failure

say "the binary interface"
scripts/check-abi.sh
# A changed field is found.
rm -rf "$build/headers"
cp -r include "$build/headers"
sed -i 's/uint32_t offset_ns;/int32_t offset_ns;/' "$build/headers/igh_mcan_pdo.h"
if scripts/check-abi.sh --headers "$build/headers" >"$build/abi.log" 2>&1; then
    echo "scripts/check-abi.sh does not find a changed field" >&2
    exit 1
fi
grep -m 1 -F "type of 'uint32_t offset_ns' changed" "$build/abi.log"

# C90 except for stdint.h; without padding, so that no byte of a struct is outside its fields.
say "headers alone, by gcc and clang"
for header in include/*.h; do
    for compiler in "gcc -std=c90 -pedantic -xc" "clang -std=c90 -pedantic -xc" \
        "gcc -std=c99 -Wpedantic -Wpadded -xc" "g++ -std=c++11 -Wpedantic -xc++" \
        "clang++ -std=c++11 -Wpedantic -xc++"; do
        # shellcheck disable=SC2086 # words
        echo "#include <$(basename "$header")>" |
            $compiler -Wall -Wextra -Werror -Iinclude -fsyntax-only -
    done
done

say "the programs in examples/c as C and C++, by gcc and clang"
warnings=(-Wall -Wextra -Wconversion -Wsign-conversion -Werror -D_POSIX_C_SOURCE=200809L -Iinclude)
for compiler in gcc clang; do
    for standard in c99 c11 c17; do
        $compiler "-std=$standard" "${warnings[@]}" -fsyntax-only examples/c/*.c
    done
done
# Fields that an initializer leaves out are 0 in both languages.
for compiler in g++ clang++; do
    for standard in c++17 c++20; do
        $compiler "-std=$standard" "${warnings[@]}" -Wno-missing-field-initializers \
            -Wno-missing-braces -fsyntax-only -xc++ examples/c/*.c
    done
done

say "the first program of API.md"
awk '/^```c$/ && !begun { on = begun = 1; next } /^```$/ { on = 0 } on' API.md >"$build/twelve.c"
gcc -std=c99 -Wall -Wextra -Wpedantic -Werror -Iinclude "$build/twelve.c" \
    "${static[@]}" -o "$build/twelve"
printf '[[gateway]]\nn = 3\n[gateway.can0]\nbitrate = 1_000_000\n' >"$build/twelve.toml"
ECAN_ECRT=$stepped "$build/twelve" "$build/twelve.toml"

say "a result that must be used"
ignored='#include "igh_adapter.h"
void f(ecan_igh_context_t *igh);
void f(ecan_igh_context_t *igh) { ecan_igh_activate(igh); }'
for compiler in "gcc -std=c99 -xc" "g++ -std=c++11 -xc++"; do
    # shellcheck disable=SC2086 # words
    $compiler -Werror -Iinclude -c -o /dev/null - <<<"$ignored" 2>/dev/null && exit 1
    # shellcheck disable=SC2086
    $compiler -Werror -DECAN_MUST_CHECK= -Iinclude -c -o /dev/null - <<<"$ignored"
done

say "every function is in the test"
capi/tests/every_function/complete.sh

say "an exception that leaves a callback"
g++ -std=c++17 -Wall -Wextra -Werror -Iinclude capi/tests/throwing_callback.cpp \
    "${static[@]}" -o "$build/throwing_callback"
for arguments in "" progress; do
    # shellcheck disable=SC2086 # none, or one
    { "$build/throwing_callback" $arguments; } 2>"$build/throwing_callback.log" && exit 1
    grep "an exception left the callback" "$build/throwing_callback.log"
done

say "the installed tree"
rm -rf "$build/installed" "$build/consumer"
cmake --install "$build" --prefix "$build/installed" >"$build/install.log"
# A tree that was moved works as well.
mv "$build/installed" "$build/moved"
trap 'rm -rf "$build/moved"' EXIT
for file in API.md CHANGELOG.md LICENSE-APACHE LICENSE-MIT docs/SIMULATION.md; do
    test -s "$build/moved/share/doc/EcanLite/$file"
done
while read -r document; do
    while read -r link; do
        [ -e "$(dirname "$document")/$link" ] ||
            { echo "$document: $link is not installed" >&2 && exit 1; }
    done < <(grep -oE '\]\([^)#:]+[)#]' "$document" | sed -E 's/^\]\(//; s/[)#]$//' | sort -u)
done < <(find "$build/moved" -name '*.md')
while read -r header; do
    grep -q '^/\* SPDX-License-Identifier: ' "$header"
done < <(find "$build/moved/include" -type f)

say "no path of this machine in the installed files of a release, addresses write-protected at the load"
sysroot=$(rustc --print sysroot)
if [ -z "$built" ] && grep -rlaF -e "$PWD" -e "$build" -e "${CARGO_HOME:-$HOME/.cargo}/" -e "$sysroot" "$build/moved"; then
    echo "these files contain a path of the build" >&2
    exit 1
fi
for library in "$build"/moved/lib*/libecan_*.so "$build"/moved/lib/*/libecan_*.so; do
    [ -e "$library" ] || continue
    readelf -dW "$library" | grep -q 'FLAGS_1.*NOW'
    readelf -lW "$library" | grep -q GNU_RELRO
done

say "projects to start from"
scripts/check-new.sh axes c "$build/moved"
scripts/check-new.sh frames cpp "$build/moved"
if [ -z "$built" ]; then
    scripts/check-new.sh frames c "$build/moved"
    scripts/check-new.sh axes cpp "$build/moved"
fi

say "scripts and programs that messages name"
while read -r command; do
    [ -x "$build/moved/bin/$command" ] || { echo "messages name $command, which is not installed" >&2 && exit 1; }
done < <(git grep -ohE '\b(ecan_[a-z_]+|setup_host)\.sh\b|\bigh_[a-z0-9_]+_(loop|demo|network)\b|\bigh_[a-z]+_(sdo|gateway_tx)_probe\b' \
    -- '*/src/*.rs' 'examples/*.[ch]' 'examples/*.rs' | sort -u)

say "AUTO warns of a header and a library that do not exist, ON rejects them"
missing=(-DECRT_INCLUDE_DIR=/no/such/include -DECRT_LIBRARY=/no/such/libethercat.so)
for mode in AUTO ON; do
    is_configured=yes
    cmake -S . -B "$build/options" "-DECAN_IGH_BUILD_DEMO=$mode" "${missing[@]}" \
        >"$build/options.log" 2>&1 || is_configured=no
    grep -q "ECRT_INCLUDE_DIR is /no/such/include: there is no ecrt.h" "$build/options.log"
    [[ $mode$is_configured == AUTOyes || $mode$is_configured == ONno ]]
done

say "consumers"
cmake -S capi/tests/consumer -B "$build/consumer" -DCMAKE_PREFIX_PATH="$build/moved" \
    >"$build/consumer.log" || { cat "$build/consumer.log"; exit 1; }
cmake --build "$build/consumer" --parallel 2
export ECAN_ECRT=$stepped
for program in port_c port_cxx port_c_static port_cxx_static protocol_c protocol_c_static; do
    "$build/consumer/$program"
done
PKG_CONFIG_PATH=$(dirname "$(find "$build/moved" -name ecan_igh_host.pc)")
export PKG_CONFIG_PATH
library_path=$(dirname "$(find "$build/moved" -name libecan_igh_host.so)")
pushd capi/tests/consumer >/dev/null
# shellcheck disable=SC2046 # pkg-config gives words
gcc port.c $(pkg-config --cflags --libs ecan_igh_host) -o "$build/consumer/by_pkg_config"
# shellcheck disable=SC2046
g++ port.cpp $(pkg-config --cflags --libs ecan_igh_host) -o "$build/consumer/by_pkg_config_cxx"
# shellcheck disable=SC2046
gcc protocol.c $(pkg-config --cflags --libs ecan_mcan_host) -o "$build/consumer/protocol_by_pkg_config"
# shellcheck disable=SC2046
gcc port.c $(pkg-config --cflags ecan_igh_host) "-L$library_path" -l:libecan_igh_host.a \
    -l:libecan_mcan_host.a -lpthread -ldl -lm -o "$build/consumer/static_by_name"
popd >/dev/null
"$build/consumer/static_by_name"
for program in by_pkg_config by_pkg_config_cxx protocol_by_pkg_config; do
    LD_LIBRARY_PATH=$library_path "$build/consumer/$program"
done

say "the build of a customer of the vendor's package, with other paths"
rm -rf "$build/vendor" && mkdir "$build/vendor"
cp capi/tests/manual_fragments.c "$build/vendor/master.c"
for tree in "$build/vendor-package" "$build/moved/share/ecan-lite/vendor-package"; do
    make -s -B -C "$build/vendor" -f "$PWD/capi/tests/vendor_build/Makefile" "PKG=$tree" "ETHERLAB=$tree"
    "$build/vendor/master"
done

# A program that calls ecrt_* itself gets the master's library, which need not have the calls of the SDK.
echo 'unsigned int ecrt_version_magic(void); unsigned int ecrt_version_magic(void) { return 0x10602; }' |
    gcc -shared -fPIC -xc - -o "$build/vendor/libmaster.so"
cmake -S . -B "$build/vendor/own" "-DECRT_LIBRARY=$build/vendor/libmaster.so" "-DECAN_BUILT_LIBRARIES=$build" \
    >"$build/vendor/own.log" || { cat "$build/vendor/own.log"; exit 1; }
ln -sf "$build"/libecan_*_host.a "$build/vendor/own"
echo 'unsigned int ecrt_version_magic(void); int main(void) { return ecrt_version_magic() != 0x10602; }' |
    gcc -xc - "-L$build/vendor/own/vendor-package/lib" -lethercat -o "$build/vendor/own/program"
"$build/vendor/own/program"

say "the C++ header and its programs"
scripts/check-cpp.sh "$build/moved" "$build/cpp"

say "all of the C side holds"
