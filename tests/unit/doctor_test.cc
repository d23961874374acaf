// `kinevox doctor` on simulated machines.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <limits>

#include "server/tools/doctor/checks.h"
#include "tests/support/temporary_folder.h"

namespace kinevox::doctor {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::Field;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

class DoctorTest : public ::testing::Test {
  protected:
    void write(const std::string& path, const std::string& text) {
        const auto file = folder_.path() / path;
        std::filesystem::create_directories(file.parent_path());
        std::ofstream(file) << text << "\n";
    }
    Facts facts() const {
        Facts facts;
        facts.machine = Machine(folder_.path());
        facts.disk_test_bytes = 1 << 20;
        return facts;
    }
    Facts facts_with(const std::string& toml) const {
        Facts out = facts();
        out.config = parse_config_toml(toml, folder_.path(), "test.toml", false);
        EXPECT_TRUE(out.config.ok()) << out.config.status();
        return out;
    }
    void usb_camera(const std::string& speed) {
        write("sys/bus/usb/devices/2-1/speed", speed);
        write("sys/bus/usb/devices/2-1/busnum", "2");
        write("sys/bus/usb/devices/2-1/devnum", "7");
        write("sys/bus/usb/devices/2-1:1.0/bInterfaceClass", "ef");
        write("sys/bus/usb/devices/2-1:1.0/bInterfaceSubClass", "05");
        write("sys/bus/usb/devices/2-1:1.1/bInterfaceClass", "ef");
        write("sys/bus/usb/devices/2-1:1.1/bInterfaceSubClass", "05");
        write("sys/bus/usb/devices/1-4:1.0/bInterfaceClass", "03");  // a mouse
        write("sys/bus/usb/devices/1-4:1.0/bInterfaceSubClass", "01");
    }
    static FoundCamera gige(const std::string& address) {
        FoundCamera camera;
        camera.serial = "F1", camera.address = address, camera.protocol = "GigEVision",
        camera.vendor = "Maker", camera.model = "M";
        return camera;
    }

    testing::TemporaryFolder folder_;
};

auto is(Severity severity, const std::string& message) {
    return AllOf(Field(&Finding::severity, severity), Field(&Finding::message, HasSubstr(message)));
}

TEST_F(DoctorTest, SmallReceiveBuffersFailOnlyWithNetworkCameras) {
    write("proc/sys/net/core/rmem_max", "212992");
    write("proc/sys/net/core/netdev_max_backlog", "10000");
    Facts some = facts();
    EXPECT_THAT(check_network(some),
                ElementsAre(is(Severity::kWarning, "212992"), is(Severity::kOk, "10000")));
    some.found = {gige("192.168.7.5")};
    const auto findings = check_network(some);
    EXPECT_THAT(findings,
                ElementsAre(is(Severity::kError, "212992, below 33554432"), is(Severity::kOk, "10000")));
    EXPECT_THAT(findings[0].fixes, ElementsAre(Fix{Fix::Kind::kSysctl, "net.core.rmem_max=33554432"}));
    write("proc/sys/net/core/rmem_max", "67108864");
    EXPECT_THAT(check_network(some), ElementsAre(is(Severity::kOk, "67108864"), is(Severity::kOk, "10000")));
}

TEST_F(DoctorTest, WarnsIfNetworkSettingsAreUnreadable) {
    EXPECT_THAT(check_network(facts()), ElementsAre(is(Severity::kWarning, "cannot be read"),
                                                    is(Severity::kWarning, "cannot be read")));
}

TEST_F(DoctorTest, FindsInterfacesWithCameras) {
    const std::vector<Interface> all{{"eth0", 0x0a000001, 0xffffff00}, {"eth1", 0xc0a80701, 0xffffff00}};
    EXPECT_THAT(with_cameras(all, {gige("192.168.7.5"), gige("192.168.7.6")}),
                ElementsAre(Field(&Interface::name, "eth1")));
    EXPECT_THAT(with_cameras(all, {gige("172.16.0.1")}), IsEmpty());
    FoundCamera usb = gige("192.168.7.5");
    usb.protocol = "USB3Vision";
    EXPECT_THAT(with_cameras(all, {usb}), IsEmpty());
}

TEST_F(DoctorTest, ChecksMtuSpeedAndPathFilter) {
    write("sys/class/net/eth1/mtu", "1500");
    write("sys/class/net/eth1/speed", "100");
    write("proc/sys/net/ipv4/conf/all/rp_filter", "1");
    write("proc/sys/net/ipv4/conf/eth1/rp_filter", "0");
    const std::vector<Interface> eth1{{"eth1", 0, 0}};
    const auto findings = check_interfaces(facts(), eth1);
    EXPECT_THAT(findings,
                ElementsAre(is(Severity::kWarning, "MTU of 1500"), is(Severity::kError, "100 Mbit/s"),
                            is(Severity::kWarning, "rp_filter 1")));
    EXPECT_THAT(findings[0].remedy, HasSubstr("ip link set eth1 mtu 9000"));
    write("sys/class/net/eth1/mtu", "9000");
    write("sys/class/net/eth1/speed", "1000");
    write("proc/sys/net/ipv4/conf/eth1/rp_filter", "2");  // the larger value counts
    EXPECT_THAT(
        check_interfaces(facts(), eth1),
        ElementsAre(is(Severity::kOk, "9000"), is(Severity::kOk, "1000"), is(Severity::kOk, "rp_filter 2")));
}

TEST_F(DoctorTest, ReportsConfiguredCamerasThatDoNotAnswer) {
    Facts some = facts_with(
        "[source]\nkind = \"cameras\"\n[source.cameras]\ncalibration_file = \"c.toml\"\n"
        "[[source.cameras.camera]]\nname = \"left\"\ndevice = \"F1\"\n"
        "[[source.cameras.camera]]\nname = \"right\"\ndevice = \"F2\"\n");
    some.found = {gige("192.168.7.5")};
    EXPECT_THAT(check_cameras(some),
                ElementsAre(is(Severity::kOk, "left is "),
                            is(Severity::kError, "right (F2) does not answer; 1 others do")));
    EXPECT_THAT(check_cameras(facts()), ElementsAre(is(Severity::kOk, "none are configured")));
}

TEST_F(DoctorTest, ChecksUsbPermissionsSpeedAndMemory) {
    usb_camera("480");
    write("sys/module/usbcore/parameters/usbfs_memory_mb", "16");
    EXPECT_THAT(check_usb(facts()),
                ElementsAre(is(Severity::kError, "/dev/bus/usb/002/007"), is(Severity::kError, "480 Mbit/s"),
                            is(Severity::kError, "usbfs_memory_mb is 16")));
    usb_camera("5000");
    write("dev/bus/usb/002/007", "");
    write("sys/module/usbcore/parameters/usbfs_memory_mb", "1000");
    EXPECT_THAT(check_usb(facts()), ElementsAre(is(Severity::kOk, "may be opened"), is(Severity::kOk, "5000"),
                                                is(Severity::kOk, "1000")));
}

TEST_F(DoctorTest, IgnoresUsbMemoryWithoutUsbCameras) {
    write("sys/module/usbcore/parameters/usbfs_memory_mb", "16");
    EXPECT_THAT(check_usb(facts()), ElementsAre(is(Severity::kOk, "usbfs_memory_mb is 16")));
}

TEST_F(DoctorTest, GpuFailsOnlyIfConfigured) {
    const Facts cuda = facts_with("[pipeline]\ndevice = \"cuda\"\n");
    EXPECT_THAT(check_gpu(facts()), ElementsAre(is(Severity::kOk, "none is configured")));
    EXPECT_THAT(check_gpu(cuda),
                ElementsAre(is(Severity::kError, "selects cuda:0, but there is no NVIDIA card")));
    write("sys/bus/pci/devices/0000:01:00.0/vendor", "0x10de");
    write("sys/bus/pci/devices/0000:01:00.0/class", "0x030000");
    EXPECT_THAT(check_gpu(facts()), ElementsAre(is(Severity::kWarning, "driver is not loaded")));
    write("proc/driver/nvidia/version",
          "NVRM version: NVIDIA UNIX x86_64 Kernel Module  535.183.01  Sun May 12");
    EXPECT_THAT(check_gpu(cuda),
                ElementsAre(is(Severity::kError, "535.183.01 is loaded, but /dev/nvidiactl is missing")));
    for (const char* node : {"nvidiactl", "nvidia0", "nvidia-uvm"}) write(std::string("dev/") + node, "");
    EXPECT_THAT(check_gpu(cuda), ElementsAre(is(Severity::kOk, "535.183.01")));
    write("proc/driver/nvidia/gpus/0000:01:00.0/information", "");
    const Facts second = facts_with("[pipeline]\ndevice = \"cuda:1\"\n");
    EXPECT_THAT(check_gpu(second), ElementsAre(is(Severity::kError,
                                                  "selects cuda:1, but NVIDIA's driver 535.183.01 "
                                                  "finds 1 GPU")));
    write("proc/driver/nvidia/gpus/0000:02:00.0/information", "");
    EXPECT_THAT(check_gpu(second), ElementsAre(is(Severity::kOk, "535.183.01")));
}

TEST_F(DoctorTest, WarnsIfHugePagesAreOff) {
    write("sys/kernel/mm/transparent_hugepage/enabled", "always madvise [never]");
    EXPECT_THAT(check_memory(facts()), ElementsAre(is(Severity::kWarning, "are off")));
    write("sys/kernel/mm/transparent_hugepage/enabled", "always [madvise] never");
    EXPECT_THAT(check_memory(facts()), ElementsAre(is(Severity::kOk, "[madvise]")));
}

TEST_F(DoctorTest, UsesTheRunningDaemonsFileLimit) {
    const std::string header = "Limit                     Soft Limit           Hard Limit           Units\n";
    write("proc/self/limits",
          header + "Max open files            1024                 524288               files");
    EXPECT_THAT(check_limits(facts()),
                ElementsAre(is(Severity::kOk, "a program started by you may have 1024")));
    write("proc/4711/comm", "exe");
    write("proc/4711/cmdline", std::string("/usr/bin/kinevoxd\0--config", 26));
    write("proc/4711/limits",
          header + "Max open files            256                  524288               files");
    EXPECT_THAT(check_limits(facts()), ElementsAre(is(Severity::kError, "process 4711) may have only 256")));
}

TEST_F(DoctorTest, WarnsIfClockIsUnsynchronised) {
    EXPECT_THAT(judge({true, false, 16000}), is(Severity::kWarning, "not synchronised"));
    EXPECT_THAT(judge({true, true, 2.5}), is(Severity::kOk, "2.5 ms"));
    EXPECT_THAT(judge({}), is(Severity::kWarning, "does not report"));
    EXPECT_TRUE(clock_state().known || !clock_state().synchronised);
}

TEST_F(DoctorTest, ChecksOwnerOfStateFolder) {
    Facts some = facts();
    EXPECT_THAT(check_state(some), ElementsAre(is(Severity::kWarning, "they are lost")));
    some.state_folder = folder_.path() / "state";
    EXPECT_THAT(check_state(some), ElementsAre(is(Severity::kOk, "is created on demand")));
    std::filesystem::create_directory(some.state_folder);
    EXPECT_THAT(check_state(some), ElementsAre(is(Severity::kOk, "belongs to")));
    chmod(some.state_folder.c_str(), 0777);
    EXPECT_THAT(check_state(some), ElementsAre(is(Severity::kError, "written by everybody")));
}

TEST_F(DoctorTest, MeasuresDiskSpaceAndSpeed) {
    Facts some = facts_with("[recording]\nmin_free_disk_mb = 1\n");
    some.recordings = folder_.path() / "not/yet/there";
    const auto findings = check_disk(some);
    ASSERT_EQ(findings.size(), 2u);
    EXPECT_THAT(findings[0].message, HasSubstr("minutes of recordings"));
    EXPECT_THAT(findings[1].message, HasSubstr("the cameras deliver 111"));  // 4 of 640 x 480 at 30
    EXPECT_TRUE(std::filesystem::is_empty(folder_.path())) << "leaves nothing";
    EXPECT_THAT(check_disk(facts()), ElementsAre(is(Severity::kOk, "records nothing")));
    some.config->recording.min_free_disk_mb = std::numeric_limits<int>::max();
    some.recordings = folder_.path();
    EXPECT_THAT(check_disk(some), ElementsAre(is(Severity::kError, "nothing can be recorded")));
}

TEST_F(DoctorTest, ReportsUnusableAddress) {
    Facts some = facts_with("[server]\nlisten = \"127.0.0.1:0\"\n");
    EXPECT_THAT(check_port(some), ElementsAre(is(Severity::kOk, "is free")));
    some = facts_with("[server]\nlisten = \"192.0.2.1:50770\"\n");  // unassigned
    EXPECT_THAT(check_port(some), ElementsAre(is(Severity::kError, "192.0.2.1:50770")));
}

TEST_F(DoctorTest, InvalidConfigurationFailsAndDefaultsApply) {
    Facts some = facts();
    some.config = parse_config_toml("[pipeline]\nvoxels = 3\n", "/", "my.toml", false);
    EXPECT_THAT(check_config(some), ElementsAre(is(Severity::kError, "my.toml")));
    EXPECT_EQ(some.settings(), DaemonConfig{});
}

TEST_F(DoctorTest, FixScriptContainsAllFixes) {
    write("proc/sys/net/core/rmem_max", "212992");
    write("proc/sys/net/core/netdev_max_backlog", "1000");
    write("sys/class/net/eth1/mtu", "1500");
    Facts some = facts();
    Findings findings = check_network(some);
    for (Finding& finding : check_interfaces(some, {{"eth1", 0, 0}})) findings.push_back(finding);
    const std::string script = fix_script(findings);
    EXPECT_THAT(script,
                HasSubstr("cat >/etc/sysctl.d/60-kinevox.conf "
                          "<<'END'\nnet.core.rmem_max=33554432\nnet.core.netdev_max_backlog=5000\nEND\n"));
    EXPECT_THAT(script, HasSubstr("\nip link set eth1 mtu 9000\n"));
    EXPECT_THAT(script, Not(HasSubstr("tmpfiles")));
    const auto file = folder_.path() / "fix.sh";
    std::ofstream(file) << script;
    EXPECT_EQ(std::system(("sh -n " + file.string()).c_str()), 0) << script;
    EXPECT_THAT(fix_script({}), HasSubstr("No fixes for root"));
}

TEST_F(DoctorTest, PrintsTextAndJson) {
    const Findings findings{{Severity::kOk, "clock", "fine"},
                            {Severity::kError, "port", "taken", "choose another"}};
    EXPECT_THAT(to_text(findings, false),
                AllOf(HasSubstr("OK      clock            fine\n"), HasSubstr("-> choose another\n"),
                      HasSubstr("1 error, 0 warnings")));
    EXPECT_THAT(to_json(findings),
                AllOf(HasSubstr("\"error_count\":1"), HasSubstr("\"level\":\"ERROR\",\"check\":\"port\"")));
    EXPECT_TRUE(any_error(findings));
    EXPECT_FALSE(any_error({findings[0]}));
}

}  // namespace
}  // namespace kinevox::doctor
