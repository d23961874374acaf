#include "server/calibration/camera_tree.h"

#include <algorithm>
#include <numeric>

namespace kinevox {

CameraTree join_cameras(int cameras, std::vector<CameraPair> pairs) {
    std::stable_sort(pairs.begin(), pairs.end(),
                     [](const CameraPair& x, const CameraPair& y) { return x.votes > y.votes; });
    std::vector<int> group(cameras), votes(cameras, 0);
    std::iota(group.begin(), group.end(), 0);
    std::vector<std::vector<std::pair<int, Rigid3>>> next(cameras);  // [from]: to, target_from_source
    for (const CameraPair& pair : pairs) {
        votes[pair.a] += pair.votes, votes[pair.b] += pair.votes;
        if (group[pair.a] == group[pair.b]) continue;
        std::replace(group.begin(), group.end(), int{group[pair.b]}, int{group[pair.a]});
        next[pair.b].emplace_back(pair.a, pair.a_from_b);
        next[pair.a].emplace_back(pair.b, pair.a_from_b.inverse());
    }
    CameraTree tree;
    tree.camera_from_world.resize(cameras);
    for (int id = 0; id < cameras; ++id) {
        std::vector<int> members;
        for (int c = 0; c < cameras; ++c)
            if (group[c] == id) members.push_back(c);
        if (members.empty()) continue;
        int root = members.front();
        for (const int c : members)
            if (votes[c] > votes[root]) root = c;
        std::vector<int> open{root};
        std::vector<bool> done(cameras, false);
        done[root] = true;
        tree.camera_from_world[root] = {};
        for (std::size_t i = 0; i < open.size(); ++i)
            for (const auto& [to, target_from_source] : next[open[i]]) {
                if (done[to]) continue;
                done[to] = true;
                tree.camera_from_world[to] = target_from_source * tree.camera_from_world[open[i]];
                open.push_back(to);
            }
        tree.groups.push_back(std::move(members));
    }
    std::stable_sort(tree.groups.begin(), tree.groups.end(),
                     [](const auto& x, const auto& y) { return x.size() > y.size(); });
    return tree;
}

}  // namespace kinevox
