// Number of calls of operator new in this process.
#ifndef COUNTING_NEW_HPP
#define COUNTING_NEW_HPP

#include <cstddef>

std::size_t allocations() noexcept;

#endif
