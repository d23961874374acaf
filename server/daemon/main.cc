#include "server/daemon/kinevoxd.h"

int main(int argc, char** argv) {
    return kinevox::run_kinevoxd(argc, argv, kinevox::kernels::make_stage_factory);
}
