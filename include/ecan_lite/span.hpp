/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: a view of consecutive elements. */
#ifndef ECAN_LITE_SPAN_HPP
#define ECAN_LITE_SPAN_HPP

#include <cstddef>
#include <iterator>
#include <type_traits>
#include <utility>

namespace ecan {

/** View of consecutive elements, as std::span of C++20: an address and a number. Owns nothing. */
template <class T>
class span {
public:
    using element_type = T;
    using value_type = std::remove_cv_t<T>;
    using iterator = T *;

    constexpr span() noexcept = default;
    constexpr span(T *data, std::size_t size) noexcept : data_(data), size_(size) {}

    /** Views an array or a container with data() and size(), such as std::array, std::vector, std::span. */
    template <class Range,
              class Pointer = decltype(std::data(std::declval<Range &>())),
              class = std::enable_if_t<
                  !std::is_same_v<std::decay_t<Range>, span> &&
                  std::is_convertible_v<std::remove_pointer_t<Pointer> (*)[], T (*)[]>>>
    constexpr span(Range &&range) noexcept : data_(std::data(range)), size_(std::size(range)) {}

    constexpr T *data() const noexcept { return data_; }
    constexpr std::size_t size() const noexcept { return size_; }
    constexpr bool empty() const noexcept { return size_ == 0; }
    constexpr T *begin() const noexcept { return data_; }
    constexpr T *end() const noexcept { return data_ + size_; }
    constexpr T &operator[](std::size_t index) const noexcept { return data_[index]; }

    /** The first elements, at most `count`. */
    constexpr span first(std::size_t count) const noexcept
    {
        return {data_, count < size_ ? count : size_};
    }

private:
    T *data_ = nullptr;
    std::size_t size_ = 0;
};

} // namespace ecan

#endif
