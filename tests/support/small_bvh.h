// The smallest BVH file that is a movement of a person: standing, then arms and a leg raised.
#pragma once

#include <string>

namespace kinevox::testing {

// `frames` of 0.1 s.
inline std::string small_bvh(int frames) {
    const auto joint = [](const std::string& name, const std::string& offset, const std::string& inside) {
        return "JOINT " + name + "\n{\nOFFSET " + offset + "\nCHANNELS 3 Zrotation Xrotation Yrotation\n" +
               inside + "}\n";
    };
    const auto end = [](const std::string& offset) { return "End Site\n{\nOFFSET " + offset + "\n}\n"; };
    const auto leg = [&](const std::string& side, const std::string& x) {
        return joint(side + "UpLeg", x + " 0 0",
                     joint(side + "Leg", "0 -42 0", joint(side + "Foot", "0 -42 0", end("0 -6 15"))));
    };
    const auto arm = [&](const std::string& side, const std::string& x) {
        return joint(side + "Arm", x + " 38 0",
                     joint(side + "ForeArm", "0 -28 0", joint(side + "Hand", "0 -25 0", end("0 -15 0"))));
    };
    std::string text =
        "HIERARCHY\nROOT Hips\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation "
        "Xrotation Yrotation\n" +
        joint("Spine", "0 12 0",
              joint("Head", "0 42 0", end("0 22 0")) + arm("Left", "18") + arm("Right", "-18")) +
        leg("Left", "9") + leg("Right", "-9") + "}\nMOTION\nFrames: " + std::to_string(frames) +
        "\nFrame Time: 0.1\n";
    for (int frame = 0; frame < frames; ++frame) {
        text += "0 95 0 0 0 0";  // the hips
        for (int j = 0; j < 14; ++j)
            text += j == 2 || j == 8 ? " 0 " + std::to_string(-10 * frame) + " 0" : " 0 0 0";
        text += "\n";
    }
    return text;
}

}  // namespace kinevox::testing
