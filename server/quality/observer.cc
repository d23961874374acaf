#include "server/quality/observer.h"

#include <oneapi/tbb/parallel_for.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <opencv2/imgproc.hpp>

#include "common/median.h"
#include "kernels/segmentation.h"
#include "server/cameras/image_mat.h"
#include "server/quality/samples.h"

namespace kinevox::quality {
namespace {

// z of the lowest measured ankle or toe.
std::optional<double> lowest_foot(const BodyPose& pose) {
    std::optional<double> lowest;
    for (const std::string_view name : {"ankle_l", "ankle_r", "toe_l", "toe_r"}) {
        const JointEstimate& joint = pose.joints[*joint_index(name)];
        if (joint.measured()) lowest = std::min(lowest.value_or(joint.in_world.z), joint.in_world.z);
    }
    return lowest;
}

constexpr double kMaxOthersFraction = 0.05;   // of the frame sets, with people who are excluded
constexpr std::size_t kBackgroundImages = 9;  // of which the median is taken

cv::Mat reduced(const Image& image, int factor) {
    const cv::Mat full = as_mat(image);
    if (factor == 1) return full;
    const cv::Size size(image.width / factor, image.height / factor);
    cv::Mat small;  // exactly that factor: a remainder at the edge is dropped
    cv::resize(full(cv::Rect(0, 0, size.width * factor, size.height * factor)), small, size, 0, 0,
               cv::INTER_AREA);
    return small;
}

Camera reduced(Camera camera, int factor) {
    const double scale = 1.0 / factor;
    camera.width /= factor, camera.height /= factor;
    camera.fx *= scale, camera.fy *= scale;
    camera.cx = (camera.cx + 0.5) * scale - 0.5, camera.cy = (camera.cy + 0.5) * scale - 0.5;
    return camera;
}

cv::Mat grey_of(const cv::Mat& image) {
    cv::Mat grey;
    if (image.channels() == 1)
        grey = image.clone();
    else
        cv::cvtColor(image, grey, cv::COLOR_BGR2GRAY);
    return grey;
}

kernels::ImageView view_of(const cv::Mat& image) {
    return {image.data, image.cols, image.rows, image.channels(), static_cast<std::ptrdiff_t>(image.step)};
}

// The still foreground is not an object but the subject's: only one camera has it, or without it too little
// remains of a person.
bool is_part_of_subject(const Samples& seen, const std::vector<cv::Mat>& still, const Measurements& without) {
    constexpr double kPerson_m = 1.2, kLoss = 0.75;
    int cameras = 0;
    for (const cv::Mat& mask : still) cameras += cv::countNonZero(mask) > 0;
    if (cameras < 2) return true;
    const double rest = without.world.subject_height_m.value_or(0);
    if (rest >= kPerson_m) return false;
    std::vector<cv::Mat> none;
    for (const cv::Mat& mask : still) none.push_back(cv::Mat::zeros(mask.size(), CV_8U));
    const auto whole = measure_world(seen, subject_silhouettes(seen, none)).subject_height_m;
    return whole && rest < kLoss * *whole;
}

}  // namespace

cv::Mat median_image(const std::vector<cv::Mat>& images) {
    cv::Mat out(images.front().size(), CV_8U);
    std::vector<std::uint8_t> values(images.size());
    for (int y = 0; y < out.rows; ++y)
        for (int x = 0; x < out.cols; ++x) {
            for (std::size_t n = 0; n < images.size(); ++n) values[n] = images[n].at<std::uint8_t>(y, x);
            out.at<std::uint8_t>(y, x) = median_of(values);
        }
    return out;
}

double quantile_or(std::vector<double> values, double q, double otherwise) {
    return values.empty() ? otherwise : quantile_of(values, q);
}

struct Observer::State {
    ObserverOptions options;
    std::vector<int> factor;  // per camera
    std::vector<std::unique_ptr<kernels::Segmenter>> segmenters;
    Samples seen;
    std::vector<double> litres;  // of the tracked volumes
    int max_followed = 0;        // subjects at once
    std::uint64_t frame_sets = 0, stride = 1;
    std::deque<char> tracked;  // per frame set; live: of the held ones
};

Observer::Observer(const std::vector<Camera>& cameras, const std::vector<std::vector<Image>>& background,
                   const ObserverOptions& options)
    : state_(std::make_unique<State>()) {
    state_->options = options;
    state_->factor.assign(cameras.size(), 1);
    state_->segmenters.resize(cameras.size());
    state_->seen.background.resize(cameras.size());
    for (std::size_t c = 0; c < cameras.size(); ++c) {
        int& factor = state_->factor[c];
        while (std::max(cameras[c].width, cameras[c].height) / factor > options.max_side_px) ++factor;
        state_->seen.cameras.push_back(reduced(cameras[c], factor));
    }
    kernels::SegmentationOptions segmentation;
    segmentation.judge_faint = options.judge_faint;
    segmentation.absorb_frames = 100'000'000;  // what stands still must stay visible
    oneapi::tbb::parallel_for(std::size_t{0}, cameras.size(), [&](std::size_t c) {
        std::vector<cv::Mat> images, greys;
        std::vector<kernels::ImageView> views;
        for (const Image& image : background[c])
            views.push_back(view_of(images.emplace_back(reduced(image, state_->factor[c]))));
        const std::size_t step = std::max<std::size_t>(1, images.size() / kBackgroundImages);
        for (std::size_t n = 0; n < images.size(); n += step) greys.push_back(grey_of(images[n]));
        state_->seen.background[c] = median_image(greys);
        state_->segmenters[c] = kernels::make_segmenter(kernels::Device::kCpu, images[0].cols, images[0].rows,
                                                        images[0].channels(), segmentation);
        state_->segmenters[c]->learn(views);
    });
}

Observer::~Observer() = default;

void Observer::add(const FrameResult& result) {
    State& state = *state_;
    state.tracked.push_back(!result.subjects.empty());
    state.max_followed = std::max(state.max_followed, static_cast<int>(result.subjects.size()));
    if (state.options.latest && state.tracked.size() > state.options.max_samples) state.tracked.pop_front();
    if (state.frame_sets++ % state.stride != 0) return;
    for (const SubjectResult& subject : result.subjects)
        if (subject.volume) state.litres.push_back(volume_litres(*subject.volume));
    Sample& sample = state.seen.samples.emplace_back();
    sample.sequence = result.sequence;
    const int people = static_cast<int>(result.subjects.size()) + result.bystanders;
    sample.are_separated = people > 1;
    sample.views.resize(state.factor.size());
    oneapi::tbb::parallel_for(std::size_t{0}, state.factor.size(), [&](std::size_t c) {
        const Image& image = result.frame_set.images[c];
        if (image.empty()) return;
        const cv::Mat small = reduced(image, state.factor[c]);
        kernels::Silhouettes silhouettes;
        state.segmenters[c]->segment(view_of(small), {}, silhouettes);
        sample.views[c] = {grey_of(small), cv::Mat(small.size(), CV_8U, silhouettes.sharp.data()).clone()};
    });
    auto& samples = state.seen.samples;
    if (samples.size() <= state.options.max_samples) return;
    if (state.options.latest) {
        samples.erase(samples.begin());
        if (state.litres.size() > state.options.max_samples) state.litres.erase(state.litres.begin());
        return;
    }
    std::vector<Sample> kept;
    for (std::size_t n = 0; n < samples.size(); n += 2) kept.push_back(std::move(samples[n]));
    samples = std::move(kept);
    state.stride *= 2;
}

std::uint64_t Observer::first_sequence() const {
    return state_->seen.samples.empty() ? 0 : state_->seen.samples.front().sequence;
}

// All but the rig. `silhouettes` become those of the moving subjects.
Measurements Observer::measure_scene(SilhouetteSet& silhouettes) const {
    const State& state = *state_;
    const Samples& seen = state.seen;
    Measurements out;
    out.frame_sets = static_cast<int>(seen.samples.size());
    for (const Camera& camera : seen.cameras) out.cameras.emplace_back().name = camera.name;
    if (seen.samples.empty()) return out;
    measure_light(seen, out.cameras);
    measure_ghosts(seen, out.cameras);
    std::vector<cv::Mat> still = measure_still(seen, out.cameras);
    silhouettes = subject_silhouettes(seen, still);
    out.world = measure_world(seen, silhouettes);
    if (is_part_of_subject(seen, still, out)) {
        for (cv::Mat& mask : still) mask = cv::Scalar(0);
        for (CameraMeasurements& camera : out.cameras)
            camera.still_area_ratio = camera.still_in_background_fraction = 0;
        silhouettes = subject_silhouettes(seen, still);
        out.world = measure_world(seen, silhouettes);
    }
    measure_people(seen, still, out);
    measure_view(seen, silhouettes, out.cameras);
    if (!state.litres.empty()) out.world.volume_litres = quantile_or(state.litres, 0.5, 0);
    const auto tracked = std::ranges::count(state.tracked, 1);
    out.pose.subject_fraction = static_cast<double>(tracked) / static_cast<double>(state.tracked.size());
    return out;
}

// `only`: the silhouettes are all of this subject.
void Observer::measure_subject(const PosedSubject& posed, const SilhouetteSet& silhouettes, bool only,
                               Measurements& out) const {
    const State& state = *state_;
    out.subject_id = posed.id;
    if (!posed.body) return;
    out.body.stature_m = posed.body->stature_m;
    std::int64_t withheld = 0, joints = 0, pose_count = 0;
    std::vector<double> stds, residuals, lowest;
    for (const PosedFrame& frame : posed.poses) {
        if (!frame.pose) continue;
        ++pose_count;
        residuals.push_back(frame.pose->contour_residual_rms_m);
        for (const JointEstimate& joint : frame.pose->joints) {
            ++joints;
            withheld += !joint.measured();
            if (joint.measured()) stds.push_back(joint.std_m);
        }
        if (const std::optional<double> z = lowest_foot(*frame.pose)) lowest.push_back(*z);
    }
    const auto tracked =
        std::min<std::ptrdiff_t>(std::ranges::count(state.tracked, 1), std::ssize(posed.poses));
    if (tracked > 0) out.pose.posed_fraction = static_cast<double>(pose_count) / static_cast<double>(tracked);
    if (pose_count == 0) return;
    out.pose.withheld_fraction = static_cast<double>(withheld) / static_cast<double>(joints);
    if (!stds.empty()) out.pose.joint_std_m = quantile_or(stds, 0.5, 0);
    if (!lowest.empty()) out.pose.lowest_m = quantile_or(lowest, 0.5, 0);
    out.pose.contour_residual_m = quantile_or(residuals, 0.5, 0);
    if (only)
        out.pose.posed_iou =
            measure_posed_iou(state.seen, silhouettes, posed.poses, *posed.body, out.cameras);
    else
        measure_posed_view(state.seen.cameras, posed.poses, out.cameras);
}

std::vector<Measurements> Observer::measure(std::span<const PosedSubject> subjects, bool selected) const {
    SilhouetteSet silhouettes;
    Measurements scene = measure_scene(silhouettes);
    scene.subjects_selected = selected;
    const bool others_excluded =
        scene.several_people_fraction - scene.merged_people_fraction > kMaxOthersFraction;
    const bool only = subjects.size() <= 1 && !selected && !others_excluded;
    if (only) {
        if (!state_->seen.samples.empty()) scene.rig = measure_rig(state_->seen, silhouettes, scene.cameras);
    } else {
        scene.followed_subjects = subjects.empty() ? state_->max_followed : static_cast<int>(subjects.size());
        // These compare the silhouettes of all people with one body.
        scene.world.subject_height_m = scene.world.max_height_m = scene.world.lowest_m = std::nullopt;
    }
    std::vector<Measurements> all(std::max<std::size_t>(1, subjects.size()), scene);
    if (state_->seen.samples.empty()) return all;
    for (std::size_t n = 0; n < subjects.size(); ++n) measure_subject(subjects[n], silhouettes, only, all[n]);
    return all;
}

}  // namespace kinevox::quality
