#include "tests/accuracy/true_joints.h"

#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace kinevox::testing {

std::map<int, TrueJoints> read_true_joints(const std::filesystem::path& file) {
    std::map<int, TrueJoints> frames;
    std::ifstream in(file);
    std::string line, cell;
    std::getline(in, line);
    std::vector<std::string> names;
    for (std::istringstream header(line); std::getline(header, cell, ',');) names.push_back(cell);
    while (std::getline(in, line)) {
        std::map<std::string, double> row;
        std::istringstream cells(line);
        for (std::size_t n = 0; n < names.size() && std::getline(cells, cell, ','); ++n)
            row[names[n]] = std::strtod(cell.c_str(), nullptr);
        TrueJoints& joints = frames[static_cast<int>(row["frame"])];
        for (std::size_t j = 0; j < kJointNames.size(); ++j) {
            const std::string name(kJointNames[j]);
            joints[j] = {row[name + "_x"], row[name + "_y"], row[name + "_z"]};
        }
    }
    return frames;
}

}  // namespace kinevox::testing
