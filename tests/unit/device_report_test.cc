#include "server/tools/devices/device_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace kinevox {
namespace {

using kernels::CpuFacts;
using kernels::CudaFacts;
using kernels::Device;
using kernels::GpuFacts;
using ::testing::HasSubstr;
using ::testing::Not;

const CpuFacts kCpu{"Maker M1", 16, {"AVX2", "AVX-512"}};

CudaFacts two_gpus() {
    CudaFacts facts;
    facts.driver_version = "12.8", facts.runtime_version = "12.4";
    facts.gpus.push_back({Device::cuda(0), "NVIDIA A", "0000:01:00.0", 9, 0, 132, std::uint64_t{80} << 30,
                          std::uint64_t{60} << 30, "", ""});
    facts.gpus.push_back({Device::cuda(1), "NVIDIA B", "0000:02:00.0", 6, 1, 20, std::uint64_t{8} << 30, 0,
                          "NVIDIA B has compute capability 6.1, 7.5 or above is needed",
                          "choose another device"});
    return facts;
}

TEST(DeviceTable, ListsEachDeviceAndMarksRecommendedOne) {
    EXPECT_EQ(device_table(kCpu, two_gpus()),
              "device   free memory          capability  state              name\n"
              "cpu      -                    -           usable             Maker M1, 16 logical cores, "
              "AVX2, AVX-512\n"
              "cuda:0   60.0 of 80.0 GiB     9.0         recommended        NVIDIA A\n"
              "cuda:1   8.0 GiB              6.1         unusable           NVIDIA B\n"
              "cuda:1: NVIDIA B has compute capability 6.1, 7.5 or above is needed; choose another device\n"
              "CUDA 12.4; the driver supports up to 12.8\n");
}

TEST(DeviceTable, NamesReasonAndRemedyWithoutGpu) {
    CudaFacts none;
    none.problem = "NVIDIA's driver is not loaded", none.remedy = "install nvidia-driver";
    const std::string table = device_table({"", 2, {}}, none);
    EXPECT_THAT(table,
                HasSubstr("recommended        unknown model, 2 logical cores, neither AVX2 nor AVX-512\n"));
    EXPECT_THAT(table, HasSubstr("\nno GPU: NVIDIA's driver is not loaded; install nvidia-driver\n"));
    EXPECT_THAT(table, Not(HasSubstr("CUDA")));
}

TEST(DeviceJson, HoldsFactsAndProblems) {
    const auto json = nlohmann::json::parse(device_json(kCpu, two_gpus()));
    EXPECT_EQ(json["recommended"], "cuda:0");
    EXPECT_EQ(json["cpu"]["logical_cores"], 16);
    EXPECT_EQ(json["cpu"]["instruction_sets"], (std::vector<std::string>{"AVX2", "AVX-512"}));
    EXPECT_EQ(json["cuda"]["driver_version"], "12.8");
    EXPECT_TRUE(json["cuda"]["problem"].is_null());
    ASSERT_EQ(json["gpus"].size(), 2u);
    const auto &first = json["gpus"][0], &second = json["gpus"][1];
    EXPECT_EQ(first["device"], "cuda:0");
    EXPECT_EQ(first["memory_free_bytes"], std::uint64_t{60} << 30);
    EXPECT_EQ(first["compute_capability"], "9.0");
    EXPECT_EQ(first["usable"], true);
    EXPECT_TRUE(first["problem"].is_null());
    EXPECT_EQ(second["usable"], false);
    EXPECT_TRUE(second["memory_free_bytes"].is_null());
    EXPECT_THAT(second["problem"].get<std::string>(), HasSubstr("6.1"));
    EXPECT_EQ(second["remedy"], "choose another device");
}

}  // namespace
}  // namespace kinevox
