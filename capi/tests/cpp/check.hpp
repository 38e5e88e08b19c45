// Checks of the C++ tests, and a count of the allocations by operator new.
#ifndef CHECK_HPP
#define CHECK_HPP

#include <cstddef>
#include <cstdio>
#include <cstdlib>
#include <string>

namespace check {
inline int failures = 0;
inline int checks = 0;

inline void that(bool holds, const char *what, const char *file, int line)
{
    checks++;
    if (!holds) {
        failures++;
        std::fprintf(stderr, "%s:%d: %s\n", file, line, what);
    }
}

/** Creates a file with this text and returns its path. */
inline std::string temporary_file(const char *text)
{
    char path[] = "/tmp/ecan_cpp_XXXXXX";
    const int descriptor = mkstemp(path);
    std::FILE *file = descriptor < 0 ? nullptr : fdopen(descriptor, "w");
    that(file != nullptr && std::fputs(text, file) >= 0 && std::fclose(file) == 0, "file", path, 0);
    return path;
}

inline int report(const char *program)
{
    std::printf("%s: %d checks, %d failed\n", program, checks, failures);
    return failures == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
} // namespace check

#define CHECK(...) check::that((__VA_ARGS__), #__VA_ARGS__, __FILE__, __LINE__)
// A line that must not be reached.
#define FAILED(what) check::that(false, what, __FILE__, __LINE__)

#endif
