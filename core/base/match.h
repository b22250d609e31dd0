#pragma once
// The one dispatch over closed sets: a switch over a std::variant's index whose bodies all inline.
// (libstdc++'s std::visit falls back to a table of function pointers beyond eleven alternatives.)

#include <utility>
#include <variant>

namespace lajolla {

namespace detail {
template <std::size_t I, class Variant, class F>
[[gnu::always_inline]] inline decltype(auto) call(Variant &v, F &f) {
    if constexpr (I < std::variant_size_v<std::remove_const_t<Variant>>) {
        auto *alternative = std::get_if<I>(&v);
        if (!alternative) __builtin_unreachable(); // the index was looked at already
        return f(*alternative);
    } else {
        return call<0>(v, f); // never reached: the switch below sees valid indices only
    }
}
} // namespace detail

// Calls f with the alternative that the variant holds and returns its result; all results are of one type.
template <class Variant, class F>
[[gnu::always_inline]] inline decltype(auto) match(Variant &v, F &&f) {
    static_assert(std::variant_size_v<std::remove_const_t<Variant>> <= 32, "add cases below");
#define LAJOLLA_CASE(I)                                                                                      \
    case I: return detail::call<I>(v, f);
#define LAJOLLA_CASES(I) LAJOLLA_CASE(I) LAJOLLA_CASE(I + 1) LAJOLLA_CASE(I + 2) LAJOLLA_CASE(I + 3)
    switch (v.index()) {
        LAJOLLA_CASES(0)
        LAJOLLA_CASES(4)
        LAJOLLA_CASES(8)
        LAJOLLA_CASES(12)
        LAJOLLA_CASES(16)
        LAJOLLA_CASES(20)
        LAJOLLA_CASES(24)
        LAJOLLA_CASES(28)
    default: __builtin_unreachable();
    }
#undef LAJOLLA_CASES
#undef LAJOLLA_CASE
}

// Calls f.template operator()<T>() for every alternative T of a variant type, in order.
template <class Variant, class F>
constexpr void for_each_alternative(F &&f) {
    [&]<std::size_t... I>(std::index_sequence<I...>) {
        (f.template operator()<std::variant_alternative_t<I, Variant>>(), ...);
    }(std::make_index_sequence<std::variant_size_v<Variant>>());
}

} // namespace lajolla
