# Packages of the server and the clients. kernels/ finds its own packages, so that it configures alone.
find_package(PkgConfig REQUIRED)
find_package(Threads REQUIRED)
find_package(Eigen3 REQUIRED NO_MODULE)
find_package(Boost REQUIRED)                      # Asio, header only
find_package(spdlog REQUIRED)
find_package(fmt REQUIRED)
find_package(tomlplusplus REQUIRED)
find_package(absl REQUIRED)
find_package(pugixml REQUIRED)                   # Qualisys calibrations are XML
find_package(yaml-cpp REQUIRED)                  # OpenCV calibrations are YAML
find_package(CLI11 REQUIRED)
find_package(nlohmann_json REQUIRED)
find_package(OpenCV REQUIRED COMPONENTS core imgproc imgcodecs videoio video calib3d aruco)
find_package(Ceres REQUIRED)                     # bundle adjustment of the cameras
find_package(Protobuf REQUIRED)
find_program(GRPC_CPP_PLUGIN grpc_cpp_plugin REQUIRED)
pkg_check_modules(GRPC REQUIRED IMPORTED_TARGET grpc++)
pkg_check_modules(ZSTD REQUIRED IMPORTED_TARGET libzstd)
pkg_check_modules(LIBAV REQUIRED IMPORTED_TARGET libavcodec libavformat libavutil libswscale)   # the studio writes H.264
pkg_check_modules(ARAVIS REQUIRED IMPORTED_TARGET aravis-0.8)   # GigE Vision and USB3 Vision cameras
pkg_check_modules(SYSTEMD REQUIRED IMPORTED_TARGET libsystemd)       # readiness and watchdog of the service
find_library(GRPC_REFLECTION_LIBRARY grpc++_reflection REQUIRED)   # has no pkg-config file in Debian
if(KINEVOX_TESTS OR NOT DEFINED KINEVOX_TESTS)
  find_package(GTest REQUIRED)
endif()
find_package(TBB REQUIRED)
find_package(benchmark)
