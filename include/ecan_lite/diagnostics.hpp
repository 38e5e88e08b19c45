/* SPDX-License-Identifier: MIT OR Apache-2.0 */
/* Copyright (c) 2026 The ECAN-Lite host SDK authors */
/** ECAN-Lite host SDK for C++17: SDO transfers on another thread, in parallel with the cycle. */
#ifndef ECAN_LITE_DIAGNOSTICS_HPP
#define ECAN_LITE_DIAGNOSTICS_HPP

#include "master.hpp"

namespace ecan {
inline namespace ECAN_LITE_STYLE {

/** A second handle of the master. It belongs to one thread, which need not be that of the cycle. */
class diagnostics {
public:
    /**
     * Opens a handle.
     *
     * @usage not rt, the thread that will use the handle
     * @return As ecan_igh_diagnostics_open().
     */
    static outcome<diagnostics> open(const master &of)
    {
        auto context = std::make_unique<ecan_igh_diagnostics_t>();
        const int code = ecan_igh_diagnostics_open(context.get(), of.raw());
        return detail::finish_with(code, diagnostics(code == ECAN_OK ? std::move(context) : nullptr));
    }

    diagnostics(diagnostics &&other) noexcept = default;
    diagnostics &operator=(diagnostics &&other) noexcept
    {
        diagnostics old(std::move(other));
        std::swap(context_, old.context_);
        return *this;
    }
    ~diagnostics()
    {
        if (context_) {
            detail::ignore(ecan_igh_diagnostics_deinit(context_.get()));
        }
    }

    /** Reads an object of a gateway; blocks. Returns the number of bytes. */
    outcome<std::size_t> sdo_upload(std::size_t slave, std::uint16_t index, std::uint8_t subindex,
                                    span<std::uint8_t> data)
    {
        std::size_t length = 0;
        const int code = ecan_igh_diagnostics_sdo_upload(raw(), slave, index, subindex, data.data(),
                                                         data.size(), &length);
        return detail::finish_with(code, length);
    }

    /** Writes an object of a gateway; blocks. */
    outcome<> sdo_download(std::size_t slave, std::uint16_t index, std::uint8_t subindex,
                           span<const std::uint8_t> data)
    {
        return detail::finish(ecan_igh_diagnostics_sdo_download(raw(), slave, index, subindex,
                                                                data.data(), data.size()));
    }

    outcome<ecan_igh_master_state_t> master_state()
    {
        ecan_igh_master_state_t state = {};
        const int code = ecan_igh_diagnostics_master_state(raw(), &state);
        return detail::finish_with(code, state);
    }

    /** The C context; a null pointer after a move. */
    ecan_igh_diagnostics_t *raw() const noexcept { return context_.get(); }

private:
    explicit diagnostics(std::unique_ptr<ecan_igh_diagnostics_t> context) noexcept
        : context_(std::move(context))
    {
    }

    std::unique_ptr<ecan_igh_diagnostics_t> context_;
};

} // namespace ECAN_LITE_STYLE
} // namespace ecan

#endif
