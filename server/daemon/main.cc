#include "server/daemon/kinevoxd.h"

int main(int argc, char** argv) {
    using namespace kinevox::kernels;
    return kinevox::run_kinevoxd(argc, argv, [] { return make_stage_factory(Device::kCuda); });
}
