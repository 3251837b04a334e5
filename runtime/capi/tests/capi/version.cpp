// The header in C++.
#include "bake.h"

int main() {
    BakeMaterial *material = nullptr;
    const BakeStatus status = bake_material_load(nullptr, nullptr, &material);
    const bool fine = bake_abi_version() == BAKE_ABI_VERSION && status == BAKE_STATUS_NULL_POINTER;
    return fine && material == nullptr ? 0 : 1;
}
