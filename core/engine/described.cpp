#include "engine/described.h"

namespace lajolla {

bool Described<std::vector<float>>::read(const Value &source, std::vector<float> &value) {
    const List *const list = source.get_if<List>();
    if (!list) return false;
    value.assign(list->size(), 0);
    return std::equal(list->begin(), list->end(), value.begin(),
                      [](const Value &item, float &v) { return Described<float>::read(item, v); });
}
Value Described<std::vector<float>>::write(const std::vector<float> &value) {
    List numbers;
    for (const float v : value) numbers.push_back(Described<float>::write(v));
    return numbers;
}

bool Described<SymmetricMatrix>::read(const Value &source, SymmetricMatrix &value) {
    std::vector<float> v;
    if (!Described<std::vector<float>>::read(source, v) || v.size() != 6) return false;
    value = {v[0], v[1], v[2], v[3], v[4], v[5]};
    return true;
}
Value Described<SymmetricMatrix>::write(const SymmetricMatrix &m) {
    return Described<std::vector<float>>::write({m.xx, m.yy, m.zz, m.xy, m.xz, m.yz});
}

} // namespace lajolla
