// `kinevox doctor` on machines that the tests made up.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <fstream>
#include <limits>

#include "server/tools/doctor/clock_state.h"
#include "server/tools/doctor/interfaces.h"
#include "server/tools/doctor/report.h"
#include "tests/unit/common/temporary_folder.h"

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

auto is(Level level, const std::string& what) {
    return AllOf(Field(&Finding::level, level), Field(&Finding::what, HasSubstr(what)));
}

TEST_F(DoctorTest, SmallReceiveBuffersAreBadOnlyWithCamerasOnTheNetwork) {
    write("proc/sys/net/core/rmem_max", "212992");
    write("proc/sys/net/core/netdev_max_backlog", "10000");
    Facts some = facts();
    EXPECT_THAT(check_network(some), ElementsAre(is(Level::kWarn, "212992"), is(Level::kOk, "10000")));
    some.found = {gige("192.168.7.5")};
    const auto findings = check_network(some);
    EXPECT_THAT(findings, ElementsAre(is(Level::kBad, "212992, below 33554432"), is(Level::kOk, "10000")));
    EXPECT_THAT(findings[0].fixes, ElementsAre(Fix{Fix::Kind::kSysctl, "net.core.rmem_max=33554432"}));
    write("proc/sys/net/core/rmem_max", "67108864");
    EXPECT_THAT(check_network(some), ElementsAre(is(Level::kOk, "67108864"), is(Level::kOk, "10000")));
}

TEST_F(DoctorTest, AnInterfaceWithoutSettingsIsNotTakenForGood) {
    EXPECT_THAT(check_network(facts()),
                ElementsAre(is(Level::kWarn, "cannot be read"), is(Level::kWarn, "cannot be read")));
}

TEST_F(DoctorTest, FindsTheInterfacesThatHaveCameras) {
    const std::vector<Interface> all{{"eth0", 0x0a000001, 0xffffff00}, {"eth1", 0xc0a80701, 0xffffff00}};
    EXPECT_THAT(with_cameras(all, {gige("192.168.7.5"), gige("192.168.7.6")}),
                ElementsAre(Field(&Interface::name, "eth1")));
    EXPECT_THAT(with_cameras(all, {gige("172.16.0.1")}), IsEmpty());
    FoundCamera usb = gige("192.168.7.5");
    usb.protocol = "USB3Vision";
    EXPECT_THAT(with_cameras(all, {usb}), IsEmpty());
}

TEST_F(DoctorTest, JudgesAnInterface) {
    write("sys/class/net/eth1/mtu", "1500");
    write("sys/class/net/eth1/speed", "100");
    write("proc/sys/net/ipv4/conf/all/rp_filter", "1");
    write("proc/sys/net/ipv4/conf/eth1/rp_filter", "0");
    const std::vector<Interface> eth1{{"eth1", 0, 0}};
    const auto findings = check_interfaces(facts(), eth1);
    EXPECT_THAT(findings, ElementsAre(is(Level::kWarn, "packets of 1500"), is(Level::kBad, "100 Mbit/s"),
                                      is(Level::kWarn, "rp_filter 1")));
    EXPECT_THAT(findings[0].mend, HasSubstr("ip link set eth1 mtu 9000"));
    write("sys/class/net/eth1/mtu", "9000");
    write("sys/class/net/eth1/speed", "1000");
    write("proc/sys/net/ipv4/conf/eth1/rp_filter", "2");  // the greater counts
    EXPECT_THAT(check_interfaces(facts(), eth1),
                ElementsAre(is(Level::kOk, "9000"), is(Level::kOk, "1000"), is(Level::kOk, "rp_filter 2")));
}

TEST_F(DoctorTest, CamerasOfTheConfigurationAnswerOrDoNot) {
    Facts some = facts_with(
        "[source]\nkind = \"cameras\"\n[source.cameras]\ncalibration = \"c.toml\"\n"
        "[[source.cameras.camera]]\nname = \"left\"\ndevice = \"F1\"\n"
        "[[source.cameras.camera]]\nname = \"right\"\ndevice = \"F2\"\n");
    some.found = {gige("192.168.7.5")};
    EXPECT_THAT(check_cameras(some), ElementsAre(is(Level::kOk, "left is "),
                                                 is(Level::kBad, "right (F2) does not answer; 1 others do")));
    EXPECT_THAT(check_cameras(facts()), ElementsAre(is(Level::kOk, "none are asked for")));
}

TEST_F(DoctorTest, AUsbCameraNeedsItsNodeItsSpeedAndMemory) {
    usb_camera("480");
    write("sys/module/usbcore/parameters/usbfs_memory_mb", "16");
    EXPECT_THAT(check_usb(facts()),
                ElementsAre(is(Level::kBad, "/dev/bus/usb/002/007"), is(Level::kBad, "480 Mbit/s"),
                            is(Level::kBad, "usbfs_memory_mb is 16")));
    usb_camera("5000");
    write("dev/bus/usb/002/007", "");
    write("sys/module/usbcore/parameters/usbfs_memory_mb", "1000");
    EXPECT_THAT(check_usb(facts()),
                ElementsAre(is(Level::kOk, "may be opened"), is(Level::kOk, "5000"), is(Level::kOk, "1000")));
}

TEST_F(DoctorTest, WithoutUsbCamerasTheirMemoryIsNoMatter) {
    write("sys/module/usbcore/parameters/usbfs_memory_mb", "16");
    EXPECT_THAT(check_usb(facts()), ElementsAre(is(Level::kOk, "usbfs_memory_mb is 16")));
}

TEST_F(DoctorTest, AGpuIsBadOnlyWhereItIsAskedFor) {
    const Facts cuda = facts_with("[pipeline]\ndevice = \"cuda\"\n");
    EXPECT_THAT(check_gpu(facts()), ElementsAre(is(Level::kOk, "none is asked for")));
    EXPECT_THAT(check_gpu(cuda), ElementsAre(is(Level::kBad, "asks for cuda")));
    write("sys/bus/pci/devices/0000:01:00.0/vendor", "0x10de");
    write("sys/bus/pci/devices/0000:01:00.0/class", "0x030000");
    EXPECT_THAT(check_gpu(facts()), ElementsAre(is(Level::kWarn, "driver is not loaded")));
    write("proc/driver/nvidia/version",
          "NVRM version: NVIDIA UNIX x86_64 Kernel Module  535.183.01  Sun May 12");
    EXPECT_THAT(check_gpu(cuda),
                ElementsAre(is(Level::kBad, "535.183.01 is loaded, but /dev/nvidiactl is missing")));
    for (const char* node : {"nvidiactl", "nvidia0", "nvidia-uvm"}) write(std::string("dev/") + node, "");
    EXPECT_THAT(check_gpu(cuda), ElementsAre(is(Level::kOk, "535.183.01")));
}

TEST_F(DoctorTest, HugePages) {
    write("sys/kernel/mm/transparent_hugepage/enabled", "always madvise [never]");
    EXPECT_THAT(check_memory(facts()), ElementsAre(is(Level::kWarn, "are off")));
    write("sys/kernel/mm/transparent_hugepage/enabled", "always [madvise] never");
    EXPECT_THAT(check_memory(facts()), ElementsAre(is(Level::kOk, "[madvise]")));
}

TEST_F(DoctorTest, TheDaemonsOwnLimitCountsWhereItRuns) {
    const std::string header = "Limit                     Soft Limit           Hard Limit           Units\n";
    write("proc/self/limits",
          header + "Max open files            1024                 524288               files");
    EXPECT_THAT(check_limits(facts()), ElementsAre(is(Level::kOk, "a program that you start may have 1024")));
    write("proc/4711/comm", "exe");
    write("proc/4711/cmdline", std::string("/usr/bin/kinevoxd\0--config", 26));
    write("proc/4711/limits",
          header + "Max open files            256                  524288               files");
    EXPECT_THAT(check_limits(facts()), ElementsAre(is(Level::kBad, "process 4711) may have only 256")));
}

TEST_F(DoctorTest, AClockThatNobodySets) {
    EXPECT_THAT(judge({true, false, 16000}), is(Level::kWarn, "not synchronised"));
    EXPECT_THAT(judge({true, true, 2.5}), is(Level::kOk, "2.5 ms"));
    EXPECT_THAT(judge({}), is(Level::kWarn, "does not tell"));
    EXPECT_TRUE(clock_state().known || !clock_state().synchronised);
}

TEST_F(DoctorTest, TheStateFolderMustBeTheDaemons) {
    Facts some = facts();
    EXPECT_THAT(check_state(some), ElementsAre(is(Level::kWarn, "all are forgotten")));
    some.state_folder = folder_.path() / "state";
    EXPECT_THAT(check_state(some), ElementsAre(is(Level::kOk, "is made when it is needed")));
    std::filesystem::create_directory(some.state_folder);
    EXPECT_THAT(check_state(some), ElementsAre(is(Level::kOk, "belongs to")));
    chmod(some.state_folder.c_str(), 0777);
    EXPECT_THAT(check_state(some), ElementsAre(is(Level::kBad, "written by everybody")));
}

TEST_F(DoctorTest, DiskSpaceAndSpeed) {
    Facts some = facts_with("[recording]\nleast_free_mb = 1\n");
    some.recordings = folder_.path() / "not/yet/there";
    const auto findings = check_disk(some);
    ASSERT_EQ(findings.size(), 2u);
    EXPECT_THAT(findings[0].what, HasSubstr("minutes of recordings"));
    EXPECT_THAT(findings[1].what, HasSubstr("the cameras bring 111"));  // 4 of 640 x 480 at 30
    EXPECT_TRUE(std::filesystem::is_empty(folder_.path())) << "leaves nothing";
    EXPECT_THAT(check_disk(facts()), ElementsAre(is(Level::kOk, "records nothing")));
    some.config->recording.min_free_mb = std::numeric_limits<int>::max();
    some.recordings = folder_.path();
    EXPECT_THAT(check_disk(some), ElementsAre(is(Level::kBad, "nothing can be recorded")));
}

TEST_F(DoctorTest, APortThatIsTaken) {
    Facts some = facts_with("[server]\nlisten = \"127.0.0.1:0\"\n");
    EXPECT_THAT(check_port(some), ElementsAre(is(Level::kOk, "is free")));
    some = facts_with("[server]\nlisten = \"192.0.2.1:50770\"\n");  // nobody's
    EXPECT_THAT(check_port(some), ElementsAre(is(Level::kBad, "192.0.2.1:50770")));
}

TEST_F(DoctorTest, AConfigurationWithAnErrorIsBadAndTheDefaultsCount) {
    Facts some = facts();
    some.config = parse_config_toml("[pipeline]\nvoxels = 3\n", "/", "my.toml", false);
    EXPECT_THAT(check_config(some), ElementsAre(is(Level::kBad, "my.toml")));
    EXPECT_EQ(some.settings(), DaemonConfig{});
}

TEST_F(DoctorTest, TheScriptMendsWhatWasFound) {
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
    EXPECT_THAT(fix_script({}), HasSubstr("nothing for root to mend"));
}

TEST_F(DoctorTest, InWordsAndAsJson) {
    const Findings findings{{Level::kOk, "clock", "fine"}, {Level::kBad, "port", "taken", "choose another"}};
    EXPECT_THAT(to_text(findings, false),
                AllOf(HasSubstr("OK    clock            fine\n"), HasSubstr("-> choose another\n"),
                      HasSubstr("1 bad, 0 to look at")));
    EXPECT_THAT(to_json(findings),
                AllOf(HasSubstr("\"bad\":1"), HasSubstr("\"level\":\"BAD\",\"check\":\"port\"")));
    EXPECT_TRUE(any_bad(findings));
    EXPECT_FALSE(any_bad({findings[0]}));
}

}  // namespace
}  // namespace kinevox::doctor
