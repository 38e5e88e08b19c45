// Options of the example: names and meaning as those of the C programs.
#ifndef ARGUMENTS_HPP
#define ARGUMENTS_HPP

#include <chrono>
#include <cstdint>
#include <optional>
#include <string>

struct arguments {
    std::optional<std::string> ecrt;
    std::chrono::microseconds cycle = std::chrono::microseconds(2000);
    std::uint32_t bitrate = 1'000'000;
    std::uint32_t pdo_n = 3;
    std::uint32_t cycles = 1000;
    std::int32_t step = 20;
    std::uint8_t channel = 0;
    bool real_time = false;
};

/** Reads the command line; ends the program after --help and after an invalid option. */
arguments read_arguments(int count, char **values);

#endif
