#include "arguments.hpp"

#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <string_view>

namespace {

constexpr const char *HELP =
    "Moves two CiA 402 axes in opposite directions\n\n"
    "Usage: two_axes [OPTIONS]\n\n"
    "  --ecrt <SETTING>    EtherCAT library: a path, sim, sim:FILE.toml [default: ECAN_ECRT]\n"
    "  --cycle-us <US>     Cycle time [default: 2000]\n"
    "  --bitrate <RATE>    Bit rate of the channel [default: 1M]\n"
    "  --pdo-n <N>         Size of the PDOs in 128 bytes [default: 3]\n"
    "  --channel <0-3>     Channel of the drives with node-IDs 1 and 2 [default: 0]\n"
    "  --cycles <N>        Number of cycles with motion [default: 1000]\n"
    "  --step <STEP>       Step per cycle, in increments [default: 20]\n"
    "  --real-time         Simulate in real time\n"
    "  --help              Print this\n";

[[noreturn]] void reject(std::string_view option, std::string_view value)
{
    std::fprintf(stderr, "two_axes: invalid value '%.*s' for %.*s; see --help\n",
                 static_cast<int>(value.size()), value.data(), static_cast<int>(option.size()),
                 option.data());
    std::exit(2);
}

template <class Number>
Number number(std::string_view option, std::string_view value, Number least, Number most)
{
    Number parsed = 0;
    const char *end = value.data() + value.size();
    const auto read = std::from_chars(value.data(), end, parsed);
    if (read.ec != std::errc() || read.ptr != end || parsed < least || parsed > most) {
        reject(option, value);
    }
    return parsed;
}

/// 500000, 500k or 1M
std::uint32_t bit_rate(std::string_view option, std::string_view value)
{
    constexpr std::uint32_t MOST = 1'000'000;
    const char factor = value.empty() ? '\0' : value.back();
    const std::string_view digits = value.substr(0, value.size() - (factor == 'k' || factor == 'M'));
    switch (factor) {
    case 'k': return 1'000 * number<std::uint32_t>(option, digits, 1, MOST / 1'000);
    case 'M': return MOST * number<std::uint32_t>(option, digits, 1, 1);
    default: return number<std::uint32_t>(option, value, 1, MOST);
    }
}

} // namespace

arguments read_arguments(int count, char **values)
{
    arguments read;
    for (int i = 1; i < count; i++) {
        const std::string_view option = values[i];
        if (option == "--help") {
            std::fputs(HELP, stdout);
            std::exit(0);
        }
        if (option == "--real-time") {
            read.real_time = true;
            continue;
        }
        const std::string_view value = i + 1 < count ? values[++i] : "";
        const auto positive = [&](std::uint32_t most) {
            return number<std::uint32_t>(option, value, 1, most);
        };
        if (option == "--ecrt") {
            read.ecrt = value;
        } else if (option == "--cycle-us") {
            read.cycle = std::chrono::microseconds(positive(1'000'000));
        } else if (option == "--bitrate") {
            read.bitrate = bit_rate(option, value);
        } else if (option == "--pdo-n") {
            read.pdo_n = positive(24);
        } else if (option == "--cycles") {
            read.cycles = positive(UINT32_MAX);
        } else if (option == "--step") {
            read.step = number<std::int32_t>(option, value, -10'000, 10'000);
        } else if (option == "--channel") {
            read.channel =
                static_cast<std::uint8_t>(number<std::uint32_t>(option, value, 0, 3));
        } else {
            reject("an option", option);
        }
    }
    return read;
}
