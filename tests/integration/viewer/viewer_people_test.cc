// The viewer with no, one, two and four people, who enter a small rendered scene one after another.
#include <QComboBox>
#include <QLabel>
#include <set>

#include "client/viewer/angle_panel.h"
#include "client/viewer/subjects.h"
#include "tests/integration/viewer/viewer_fixture.h"

namespace kinevox::viewer {
namespace {

constexpr double kMinDrawnFraction = 0.8, kMinTint = 0.12;
constexpr int kMaxColouredPixels = 50;
// The people are side by side, seen from above, so that they hide little of each other.
const OrbitCamera kAboveAll{.azimuth_deg = 20, .elevation_deg = 35, .distance_m = 7};

using Colour = QVector3D;  // red, green, blue; 0 to 255

Colour colour_of(const QColor& c) {
    return {static_cast<float>(c.red()), static_cast<float>(c.green()), static_cast<float>(c.blue())};
}

class ViewerPeopleTest : public ViewerTest {
  protected:
    void SetUp() override {
        const auto session = folder_.path() / "session";
        const testing::Ran rendered = testing::run(
            {KINEVOX_STUDIO, "--scene", KINEVOX_FOUR_PEOPLE, "--out", session.string(), "--no-masks"},
            folder_.path());
        ASSERT_EQ(rendered.status, 0) << rendered.errors;
        daemon_ = start_daemon(
            fmt::format("[server]\nlisten = \"127.0.0.1:0\"\n[source]\nkind = \"session\"\nautostart = "
                        "false\nsession_file = \"{}\"\npacing = \"real_time\"\nloop = true\n[tracking]\n"
                        "max_subjects = 4\n[pose]\ndatabase_file = \"\"\nauto_fit_body = false\n",
                        (session / "session.toml").string()));
        show();
        choice_ = window_->angles().findChild<QComboBox*>("subject");
        compared_ = window_->angles().findChild<QComboBox*>("compared_subject");
    }

    // The latest; another thread replaces it at any time.
    std::shared_ptr<const ShownVolume> volume() const { return window_->feed().volume(); }
    static std::vector<std::uint32_t> ids(const ShownVolume* volume) {
        std::vector<std::uint32_t> found;
        if (volume)
            for (const ShownSubject& subject : volume->subjects)
                if (subject.point_count > 0) found.push_back(subject.id);
        return found;
    }
    // A volume with that number of people who are all in the choice of subjects; else null. They leave when
    // the session begins again, and may have other ids then: what needs them is done in one condition of
    // wait().
    std::shared_ptr<const ShownVolume> listed(std::size_t count) const {
        auto latest = volume();
        const std::vector<std::uint32_t> present = ids(latest.get());
        std::vector<std::uint32_t> entries;
        for (int n = 0; n < choice_->count(); ++n) entries.push_back(choice_->itemData(n).toUInt());
        return present.size() == count && choice_->isVisible() && entries == present ? latest : nullptr;
    }
    std::uint32_t selected() const { return window_->subjects().selected(); }
    void choose(QComboBox* box, std::uint32_t id) {
        box->setCurrentIndex(box->findData(id));
        Q_EMIT box->activated(box->currentIndex());
    }

    // Paints now: with other events, other volumes would arrive.
    QImage painted() {
        window_->scene().update();
        QEvent request(QEvent::UpdateRequest);
        QApplication::sendEvent(&window_->scene(), &request);
        return window_->scene().grabFramebuffer();
    }
    // The fraction of a subject's points that is drawn, and their mean colour: what differs from the scene
    // without volumes.
    std::pair<double, Colour> drawn(const QImage& with, const QImage& without, const ShownVolume& shown,
                                    const ShownSubject& subject) {
        double count = 0;
        Colour sum;
        for (std::size_t n = 0; n < subject.point_count; ++n) {
            const SurfacePoint& p = shown.points[subject.first_point + n];
            const QPoint at = pixel_of({p.x, p.y, p.z});
            if (!with.rect().contains(at) || with.pixel(at) == without.pixel(at)) continue;
            sum += colour_of(with.pixelColor(at));
            ++count;
        }
        return {count / static_cast<double>(subject.point_count), sum / static_cast<float>(count)};
    }
    // Why not all volumes are drawn, each in the colour of its list entry unless it is selected.
    std::string wrong_drawing(const std::shared_ptr<const ShownVolume>& shown) {
        SceneView& scene = window_->scene();
        scene.show_volume(shown);
        const SceneItems items =
            std::exchange(scene.items(), {.volume = false, .skeleton = false, .cameras = false});
        const QImage without = painted();
        scene.items().volume = true;
        std::vector<QImage> images;  // with each of them selected
        for (const ShownSubject& subject : shown->subjects) {
            choose(choice_, subject.id);
            images.push_back(painted());
        }
        scene.items() = items;
        for (std::size_t n = 0; n < images.size(); ++n) {
            const ShownSubject& subject = shown->subjects[n];
            const auto [fraction, own] = drawn(images[n], without, *shown, subject);
            const Colour tinted = drawn(images[(n + 1) % images.size()], without, *shown, subject).second;
            const Colour towards = colour_of(entry_colour(subject.id)) - own;
            const double tint = QVector3D::dotProduct(tinted - own, towards) / towards.lengthSquared();
            if (fraction < kMinDrawnFraction)
                return fmt::format("only {:.2f} of subject {} is drawn", fraction, subject.id);
            if (tint < kMinTint)
                return fmt::format("subject {} has {:.2f} of its colour while another one is selected",
                                   subject.id, tint);
        }
        return "";
    }
    // Whether the check holds while four are listed.
    template <class Check>
    bool with_four(const Check& check) {
        return wait([&] {
            const auto shown = listed(4);
            return shown && check(shown->subjects);
        });
    }
    // Of the list's icon.
    QColor entry_colour(std::uint32_t id) const {
        return choice_->itemIcon(choice_->findData(id)).pixmap(16, 16).toImage().pixelColor(8, 8);
    }

    std::unique_ptr<testing::ChildProcess> daemon_;
    QComboBox *choice_ = nullptr, *compared_ = nullptr;
};

TEST_F(ViewerPeopleTest, ShowsNoneOneTwoAndFourAndSelectsEach) {
    SceneView& scene = window_->scene();
    const auto shows_none = [&] {
        const auto shown = volume();
        return shown && shown->subjects.empty() && window_->status_line().startsWith("Live") &&
               window_->status_line().contains("no subject") &&
               coloured_pixels(scene.grabFramebuffer()) < kMaxColouredPixels;
    };
    press("frusta");  // the images in them have colours
    press("start");
    ASSERT_TRUE(wait(shows_none)) << window_->status_line().toStdString();
    const std::uint64_t first = volume()->sequence;
    EXPECT_TRUE(wait([&] { return volume()->sequence > first + 3; })) << "it stands still";
    EXPECT_FALSE(choice_->isVisible());
    painted();
    save_screenshot("people_none");

    ASSERT_TRUE(wait([&] { return ids(volume().get()).size() == 1 && shows_person(); }))
        << window_->status_line().toStdString();
    EXPECT_FALSE(choice_->isVisible());
    painted();
    save_screenshot("people_one");

    scene.set_following(false);
    scene.eye() = kAboveAll;
    ASSERT_TRUE(wait([&] { return listed(2) != nullptr; })) << window_->status_line().toStdString();
    for (int n = 0; n < 2; ++n)
        EXPECT_EQ(choice_->itemText(n), QString("Subject %1").arg(choice_->itemData(n).toUInt()));
    painted();
    save_screenshot("people_two");

    ASSERT_TRUE(wait([&] { return listed(4) != nullptr; })) << window_->status_line().toStdString();
    // By the choice, by a click on another one, and by the key in turns.
    for (std::size_t n = 0; n < 4; ++n)
        EXPECT_TRUE(with_four([&](const auto& subjects) {
            choose(choice_, subjects[n].id);
            return selected() == subjects[n].id;
        })) << n;
    for (std::size_t n = 0; n < 4; ++n)
        EXPECT_TRUE(with_four([&](const auto& subjects) {
            QTest::mouseClick(&scene, Qt::LeftButton, {}, pixel_of(subjects[n].centre_in_world));
            return selected() == subjects[n].id;
        })) << n;
    EXPECT_TRUE(with_four([&](const auto&) {
        const std::uint32_t before = selected();
        std::set<std::uint32_t> seen;
        for (int n = 0; n < 4; ++n) {
            press("next_subject");
            seen.insert(selected());
        }
        return seen.size() == 4 && selected() == before;
    }));
    press("next_subject");
    EXPECT_TRUE(wait([&] { return choice_->currentData().toUInt() == selected(); }));

    std::string wrong = "four are not listed";
    EXPECT_TRUE(wait([&] {
        if (const auto shown = listed(4)) wrong = wrong_drawing(shown);
        return wrong.empty();
    })) << wrong;
    EXPECT_TRUE(with_four([&](const auto& subjects) {
        std::set<QRgb> colours;
        for (const ShownSubject& subject : subjects) colours.insert(entry_colour(subject.id).rgb());
        return colours.size() == 4;
    }));

    // The compared one's angles are below the selected one's.
    EXPECT_TRUE(with_four([&](const auto& subjects) {
        choose(choice_, subjects[3].id);
        choose(compared_, subjects[1].id);
        const QString style = "color: " + entry_colour(subjects[1].id).name();
        const auto shows_angle = [&](const QLabel* label) {
            return label->isVisible() && label->styleSheet() == style &&
                   label->text().contains(QChar(0x00b0));
        };
        return window_->subjects().compared() == subjects[1].id &&
               std::ranges::count_if(window_->angles().findChildren<QLabel*>(), shows_angle) == 3;
    }));
    EXPECT_TRUE(with_four([&](const auto& subjects) {
        const std::uint32_t id = subjects[2].id;
        if (window_->subjects().name_of(id).empty())
            kinevox({"subjects", "name", std::to_string(id), "Anna B."});
        const QString line = window_->status_line();
        return choice_->itemText(choice_->findData(id)) == QString("Anna B. (%1)").arg(id) &&
               line.count("litres") == 4;
    })) << window_->status_line().toStdString();
    painted();
    save_screenshot("people_four");

    EXPECT_TRUE(wait(shows_none)) << window_->status_line().toStdString();
    painted();
    save_screenshot("people_gone");
}

}  // namespace
}  // namespace kinevox::viewer
