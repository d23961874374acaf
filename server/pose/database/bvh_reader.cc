#include "server/pose/database/bvh_reader.h"

#include <fmt/format.h>

#include <charconv>
#include <cmath>
#include <numbers>
#include <optional>

namespace kinevox {
namespace {

constexpr std::size_t kMaxJoints = 512, kMaxValues = std::size_t{1} << 26;
constexpr double kMaxNumber = 1e7;

class Parser {
  public:
    Parser(std::string_view text, const std::string& name) : text_(text), name_(name) {}

    absl::StatusOr<BvhMotion> parse() {
        if (!expect("HIERARCHY") || !expect("ROOT") || !hierarchy() || !expect("MOTION") || !motion())
            return error_;
        return std::move(out_);
    }

  private:
    // The next word; empty at the end.
    std::string_view word() {
        while (at_ < text_.size() && is_space(text_[at_])) {
            if (text_[at_] == '\n') ++line_;
            ++at_;
        }
        const std::size_t begin = at_;
        while (at_ < text_.size() && !is_space(text_[at_])) ++at_;
        return text_.substr(begin, at_ - begin);
    }
    static bool is_space(char c) {
        return c == ' ' || c == '\t' || c == '\n' || c == '\r' || c == '\f' || c == '\v';
    }

    bool fail(const std::string& what) {
        error_ = absl::InvalidArgumentError(fmt::format("{}:{}: {}", name_, line_, what));
        return false;
    }
    static std::string shown(std::string_view word) {
        if (word.empty()) return "the file's end";
        std::string out = "'";
        for (const char c : word.substr(0, 40)) out += c >= ' ' && c < 127 ? c : '?';
        out += '\'';
        return out;
    }
    bool expect(std::string_view what) {
        const std::string_view got = word();
        return got == what ||
               fail(fmt::format("{} where {} was expected; is this a BVH file?", shown(got), what));
    }
    bool number(double& value, const char* what) {
        const std::string_view got = word();
        const auto [end, error] = std::from_chars(got.data(), got.data() + got.size(), value);
        if (error != std::errc() || end != got.data() + got.size() || !(std::fabs(value) <= kMaxNumber))
            return fail(fmt::format("{} where a number was expected ({})", shown(got), what));
        return true;
    }
    bool vector(Vec3& out) { return number(out.x, "x") && number(out.y, "y") && number(out.z, "z"); }

    bool channels(BvhJoint& joint) {
        double count = 0;
        if (!number(count, "of channels")) return false;
        if (count != std::floor(count) || count < 0 || count > 6)
            return fail(fmt::format("{} channels; 0 to 6 are possible", count));
        joint.first_value = out_.values_per_frame;
        for (int n = 0; n < static_cast<int>(count); ++n) {
            static constexpr std::string_view kNames[6] = {"Xposition", "Yposition", "Zposition",
                                                           "Xrotation", "Yrotation", "Zrotation"};
            const std::string_view got = word();
            int kind = 0;
            while (kind < 6 && got != kNames[kind]) ++kind;
            if (kind == 6)
                return fail(fmt::format("{} is not a channel; expected Xposition to Zrotation", shown(got)));
            joint.channels.push_back(static_cast<BvhChannel>(kind));
            ++out_.values_per_frame;
        }
        return true;
    }

    // After ROOT: names, braces, offsets, channels, without recursion.
    bool hierarchy() {
        if (!open_joint(-1)) return false;
        std::vector<int> open{0};
        while (!open.empty()) {
            const std::string_view got = word();
            const int joint = open.back();
            if (got == "}") {
                open.pop_back();
            } else if (got == "OFFSET") {
                if (!vector(out_.joints[joint].offset)) return false;
            } else if (got == "CHANNELS") {
                if (!out_.joints[joint].channels.empty()) return fail("second CHANNELS of the same joint");
                if (!channels(out_.joints[joint])) return false;
            } else if (got == "JOINT") {
                if (!open_joint(joint)) return false;
                open.push_back(static_cast<int>(out_.joints.size()) - 1);
            } else if (got == "End") {
                BvhJoint& last = out_.joints[joint];
                if (!expect("Site") || !expect("{") || !expect("OFFSET") || !vector(last.end) || !expect("}"))
                    return false;
                last.has_end = true;
            } else {
                return fail(
                    fmt::format("{} where OFFSET, CHANNELS, JOINT, End Site or }} was expected", shown(got)));
            }
        }
        return true;
    }
    bool open_joint(int parent) {
        if (out_.joints.size() == kMaxJoints) return fail(fmt::format("more than {} joints", kMaxJoints));
        // Names may have spaces in them: all up to the line's end or the brace.
        std::string name(word());
        for (;;) {
            const std::string_view more = word();
            if (more == "{") break;
            if (more.empty() || name.size() > 100) return fail("joint name without {");
            name.append(" ").append(more);
        }
        if (name.empty()) return fail("joint without a name");
        BvhJoint& joint = out_.joints.emplace_back();
        joint.name = std::move(name);
        joint.parent = parent;
        return true;
    }

    bool motion() {
        double frames = 0;
        if (!expect("Frames:") || !number(frames, "of frames")) return false;
        if (frames != std::floor(frames) || frames < 1)
            return fail(fmt::format("{} frames; at least 1 is needed", frames));
        if (!expect("Frame") || !expect("Time:") || !number(out_.frame_time_s, "seconds a frame"))
            return false;
        if (!(out_.frame_time_s > 0)) return fail("frame time is not positive");
        if (out_.values_per_frame == 0) return fail("hierarchy without channels");
        const double wanted = frames * out_.values_per_frame;
        if (wanted > static_cast<double>(kMaxValues)) return fail("too many values; shorten the file");
        // Rejects impossible counts early: a number takes at least two characters.
        if (wanted > static_cast<double>(text_.size() - at_) / 2 + 1)
            return fail("fewer values than the frames need");
        out_.frames = static_cast<int>(frames);
        out_.values.reserve(static_cast<std::size_t>(wanted));
        for (std::size_t n = 0; n < static_cast<std::size_t>(wanted); ++n) {
            double value = 0;
            if (!number(value, "of a frame")) return false;
            out_.values.push_back(static_cast<float>(value));
        }
        const std::string_view rest = word();
        return rest.empty() || fail(fmt::format("{} after the last frame", shown(rest)));
    }

    std::string_view text_;
    const std::string& name_;
    std::size_t at_ = 0;
    int line_ = 1;
    BvhMotion out_;
    absl::Status error_;
};

std::vector<Rigid3> pose_of(const BvhMotion& motion, const float* values) {
    std::vector<Rigid3> world(motion.joints.size());
    for (std::size_t n = 0; n < motion.joints.size(); ++n) {
        const BvhJoint& joint = motion.joints[n];
        Rigid3 local{{}, joint.offset};
        Vec3 shift;
        for (std::size_t k = 0; values && k < joint.channels.size(); ++k) {
            const double value = values[joint.first_value + static_cast<int>(k)];
            const double angle = value * std::numbers::pi / 180;
            switch (joint.channels[k]) {
                case BvhChannel::kXposition:
                    shift.x = value;
                    break;
                case BvhChannel::kYposition:
                    shift.y = value;
                    break;
                case BvhChannel::kZposition:
                    shift.z = value;
                    break;
                case BvhChannel::kXrotation:
                    local.rotation = local.rotation * rotation_x(angle);
                    break;
                case BvhChannel::kYrotation:
                    local.rotation = local.rotation * rotation_y(angle);
                    break;
                case BvhChannel::kZrotation:
                    local.rotation = local.rotation * rotation_z(angle);
                    break;
            }
        }
        local.translation += shift;
        world[n] = joint.parent < 0 ? local : world[joint.parent] * local;
    }
    return world;
}

}  // namespace

std::vector<Rigid3> BvhMotion::pose(int frame) const {
    return pose_of(*this, values.data() + static_cast<std::size_t>(frame) * values_per_frame);
}

std::vector<Rigid3> BvhMotion::rest() const {
    return pose_of(*this, nullptr);
}

absl::StatusOr<BvhMotion> parse_bvh(std::string_view text, const std::string& name_for_errors) {
    return Parser(text, name_for_errors).parse();
}

}  // namespace kinevox
