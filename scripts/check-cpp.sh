#!/usr/bin/env bash
# Proves the C++ header of an installed tree with g++: compiles it alone and the examples (found by find_package)
# in both error styles as C++17, and runs the tests of its behaviour. With --all also as C++20 and with clang++ if
# that is there, the behaviour with g++ under AddressSanitizer and UndefinedBehaviorSanitizer, with clang++ under
# valgrind, and the examples under valgrind. Needs cmake and g++, --all also valgrind.
#
#     scripts/check-cpp.sh [--all] INSTALLED_TREE [WORK_DIRECTORY]
set -euo pipefail
cd "$(dirname "$0")/.."
all=
[ "$1" != --all ] || { all=yes && shift; }
installed=$(cd "$1" && pwd)
work=${2:-build/cpp}
mkdir -p "$work"
work=$(cd "$work" && pwd)
unset ECAN_ECRT

warnings=(-Wall -Wextra -Wpedantic -Wconversion -Wsign-conversion -Wshadow -Werror)
results=(-DECAN_LITE_NO_EXCEPTIONS -fno-exceptions -fno-rtti)
library_path=$(dirname "$(find "$installed" -name libecan_igh_host.a)")
static=("-L$library_path" -l:libecan_igh_host.a -l:libecan_mcan_host.a -lpthread -ldl -lm)
include=-I$installed/include
memcheck=(valgrind --quiet --error-exitcode=1 --leak-check=full "--errors-for-leak-kinds=definite,indirect")

say() { printf -- '-- C++: %s\n' "$1"; }

say "every result code"
while read -r code; do
    grep -q "= $code," "$installed/include/ecan_lite/error.hpp" ||
        { echo "$code is missing in ecan_lite/error.hpp" >&2 && exit 1; }
done < <(sed -nE 's/^ *(ECAN_(OK|ERR_[A-Z_]+)) =.*/\1/p' "$installed/include/igh_ecan_common.h")

say "each header alone"
for header in "$installed"/include/ecan_lite/*.hpp; do
    echo "#include <ecan_lite/$(basename "$header")>" | g++ -std=c++17 "${warnings[@]}" "$include" \
        -fsyntax-only -xc++ -
done

say "the program of API.md"
{
    echo '#include <ecan_lite.hpp>'
    echo 'using namespace std::chrono_literals;'
    echo 'void run(ecan::span<const std::uint8_t> data);'
    echo 'void run(ecan::span<const std::uint8_t> data) {'
    awk '/^```cpp$/ { on = 1; next } /^```$/ { on = 0 } on' API.md
    echo '}'
} >"$work/api.cpp"
g++ -std=c++17 "${warnings[@]}" "$include" -fsyntax-only "$work/api.cpp"

compilers=(g++) standards=(17)
if [ -n "$all" ]; then
    standards+=(20)
    if command -v clang++ >/dev/null; then
        compilers+=(clang++)
    else
        echo "skipped: clang++ is not there"
    fi
fi
for compiler in "${compilers[@]}"; do
    for standard in "${standards[@]}"; do
        say "$compiler, C++$standard"
        for style in "" "${results[*]}"; do
            # shellcheck disable=SC2086 # none, or several
            echo "#include <ecan_lite.hpp>" | "$compiler" "-std=c++$standard" "${warnings[@]}" $style \
                "$include" -fsyntax-only -xc++ -
        done
        examples=$work/examples-$compiler-$standard
        cmake -S examples/cpp -B "$examples" -DCMAKE_PREFIX_PATH="$installed" \
            -DCMAKE_CXX_COMPILER="$compiler" -DCMAKE_CXX_STANDARD="$standard" \
            -DCMAKE_CXX_FLAGS="-Werror" >"$work/examples.log" || { cat "$work/examples.log"; exit 1; }
        cmake --build "$examples" --parallel 2 >"$work/examples.log" ||
            { cat "$work/examples.log"; exit 1; }
        "$examples/two_axes" --ecrt sim --bitrate 1000k --cycles 200 | grep -q '^axis 1: position '
        "$examples/frames" --ecrt sim | grep -q '^10F '
    done

    say "behaviour, $compiler"
    # The other compiler's programs run under valgrind.
    sanitizers=() run=()
    if [ "$compiler" != g++ ]; then
        run=("${memcheck[@]}")
    elif [ -n "$all" ]; then
        sanitizers=(-fsanitize=address -fsanitize=undefined -fno-sanitize-recover=undefined)
    fi
    "$compiler" -std=c++17 -gdwarf-4 "${warnings[@]}" ${sanitizers[@]+"${sanitizers[@]}"} "$include" \
        capi/tests/cpp/exceptions.cpp capi/tests/cpp/counting_new.cpp "${static[@]}" \
        -o "$work/exceptions-$compiler"
    ${run[@]+"${run[@]}"} "$work/exceptions-$compiler" 2>"$work/exceptions.log" ||
        { cat "$work/exceptions.log"; exit 1; }
    "$compiler" -std=c++17 -gdwarf-4 "${warnings[@]}" "${results[@]}" ${sanitizers[@]+"${sanitizers[@]}"} \
        "$include" capi/tests/cpp/results.cpp "${static[@]}" -o "$work/results-$compiler"
    ${run[@]+"${run[@]}"} "$work/results-$compiler" 2>"$work/results.log" ||
        { cat "$work/results.log"; exit 1; }
done

if [ -n "$all" ]; then
    say "examples under valgrind"
    "${memcheck[@]}" "$work/examples-g++-17/two_axes" --ecrt sim --cycles 20 >/dev/null
    "${memcheck[@]}" "$work/examples-g++-17/frames" --ecrt sim >/dev/null
fi

say "invalid options are rejected"
grep -q "invalid value '0' for --cycle-us" < <("$work/examples-g++-17/two_axes" --cycle-us 0 2>&1)
grep -q 'two_axes: .*not found' < <("$work/examples-g++-17/two_axes" --ecrt /nonexistent.so 2>&1)
