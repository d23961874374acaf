// Whom to follow: regions, the nearest, an operator's requests.
#include "server/pipeline/tracking/subject_rules.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/pipeline/subject_control.h"

namespace kinevox {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

// An L: the square from (0, 0) to (2, 2) without its corner beyond (1, 1).
const FloorRegion kL{{{0, 0}, {2, 0}, {2, 1}, {1, 1}, {1, 2}, {0, 2}}};

std::vector<std::uint32_t> followed(std::vector<Person>& people, const SubjectRules& rules,
                                    const SubjectRequests& requests, int max_subjects) {
    choose_followed(people, rules, requests, max_subjects);
    std::vector<std::uint32_t> ids;
    for (const Person& person : people)
        if (person.followed == Followed::kYes) ids.push_back(person.id);
    return ids;
}

TEST(FloorRegion, KnowsInsideAndDistance) {
    EXPECT_NEAR(kL.distance_m({0.5, 0.5}), -0.5, 1e-9);
    EXPECT_NEAR(kL.distance_m({1.5, 1.5}), 0.5, 1e-9);
    EXPECT_NEAR(kL.distance_m({3, 0.5}), 1, 1e-9);
    EXPECT_EQ(kL.check(), "");
}

TEST(FloorRegion, RejectsWhatIsNoRegion) {
    EXPECT_THAT((FloorRegion{{{0, 0}, {1, 1}}}).check(), HasSubstr("at least 3"));
    EXPECT_THAT((FloorRegion{{{0, 0}, {1, 1}, {2, 2}}}).check(), HasSubstr("no area"));
    EXPECT_THAT((FloorRegion{{{0, 0}, {2, 2}, {2, 0}, {0, 2.5}}}).check(), HasSubstr("cross"));
    EXPECT_THAT((FloorRegion{{{0, 0}, {2e4, 2}, {2, 0}}}).check(), HasSubstr("1000"));
}

TEST(SubjectRules, FollowsInsideTheRegionsOnly) {
    SubjectRules rules;
    rules.capture_regions = {kL};
    rules.keep_out_regions = {{{{0, 0}, {0.4, 0}, {0.4, 2}, {0, 2}}}};
    std::vector<Person> people{{1, {0.7, 0.7}}, {2, {1.5, 1.5}}, {3, {0.2, 1}}, {4, {1.8, 0.5}}};
    EXPECT_THAT(followed(people, rules, {}, 4), ElementsAre(1, 4));
    EXPECT_EQ(people[1].followed, Followed::kOutside);
    EXPECT_EQ(people[2].followed, Followed::kOutside);
}

TEST(SubjectRules, KeepsWhoSwaysAtABorder) {
    SubjectRules rules;
    rules.capture_regions = {kL};
    std::vector<Person> people{{1, {1.95, 0.5}}};
    EXPECT_THAT(followed(people, rules, {}, 1), ElementsAre(1));
    people[0].on_floor.x = 2.1;
    EXPECT_THAT(followed(people, rules, {}, 1), ElementsAre(1));
    people[0].on_floor.x = 2.2;
    EXPECT_THAT(followed(people, rules, {}, 1), IsEmpty());
    people[0].on_floor.x = 2.1;
    EXPECT_THAT(followed(people, rules, {}, 1), IsEmpty());
}

TEST(SubjectRules, FollowsWhoCameFirst) {
    std::vector<Person> people{{2, {3, 0}, Followed::kYes}, {4, {0, 0}}, {5, {0.1, 0}}};
    EXPECT_THAT(followed(people, {}, {}, 2), ElementsAre(2, 4));
    EXPECT_EQ(people[2].followed, Followed::kTooMany);
    // A person who is known from before returns: who is followed stays so.
    people.insert(people.begin(), Person{1, {0, 1}});
    EXPECT_THAT(followed(people, {}, {}, 2), ElementsAre(2, 4));
}

TEST(SubjectRules, FollowsTheNearestAndChangesOnlyForAClearlyNearer) {
    SubjectRules rules;
    rules.follow = SubjectRules::Follow::kNearest;
    rules.point = {1, 0};
    std::vector<Person> people{{1, {3, 0}}, {2, {1.5, 0}}};
    EXPECT_THAT(followed(people, rules, {}, 1), ElementsAre(2));
    people[0].on_floor.x = 0.7;
    EXPECT_THAT(followed(people, rules, {}, 1), ElementsAre(2));
    people[0].on_floor.x = 1;
    EXPECT_THAT(followed(people, rules, {}, 1), ElementsAre(1));
}

TEST(SubjectRules, ObeysRequests) {
    SubjectRules rules;
    rules.capture_regions = {kL};
    std::vector<Person> people{{1, {0.5, 0.5}}, {2, {5, 5}}, {3, {0.6, 0.5}}};
    EXPECT_THAT(followed(people, rules, {.only = {2}, .ignored = {}}, 2), ElementsAre(2)) << "wherever it is";
    EXPECT_EQ(people[0].followed, Followed::kIgnored);
    EXPECT_THAT(followed(people, rules, {.only = {}, .ignored = {1}}, 2), ElementsAre(3));
}

std::vector<KnownSubject> known(const std::vector<std::uint32_t>& ids) {
    std::vector<KnownSubject> out;
    for (const std::uint32_t id : ids) out.push_back({.id = id, .name = "", .present = true});
    return out;
}

TEST(SubjectControl, NamesTheSubjectsThereAre) {
    SubjectControl control(2);
    EXPECT_EQ(control.ignore({1}).code(), absl::StatusCode::kNotFound);
    control.publish(known({1, 3, 4}));
    const absl::Status unknown = control.follow_only({1, 2});
    EXPECT_EQ(unknown.code(), absl::StatusCode::kNotFound);
    EXPECT_THAT(unknown.message(), HasSubstr("no subject 2; choose one of 1, 3, 4"));
    EXPECT_THAT(control.requests().only, IsEmpty()) << "an error changes nothing";
    EXPECT_EQ(control.follow_only({}).code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(control.follow_only({1, 3, 4}).code(), absl::StatusCode::kInvalidArgument);
    EXPECT_TRUE(control.follow_only({3, 3, 1}).ok());
    EXPECT_THAT(control.requests().only, ElementsAre(1, 3));
}

TEST(SubjectControl, FollowsAndIgnores) {
    SubjectControl control(2);
    control.publish(known({1, 2, 3}));
    EXPECT_TRUE(control.ignore({2, 3}).ok());
    EXPECT_THAT(control.requests().ignored, ElementsAre(2, 3));
    EXPECT_TRUE(control.follow_only({2}).ok());
    EXPECT_THAT(control.requests().ignored, ElementsAre(3));
    EXPECT_EQ(control.ignore({2}).code(), absl::StatusCode::kFailedPrecondition) << "none would be left";
    control.follow_all();
    EXPECT_THAT(control.requests().only, IsEmpty());
    EXPECT_THAT(control.requests().ignored, IsEmpty());
}

TEST(SubjectControl, KeepsNamesOfThoseWhoMayReturn) {
    SubjectControl control(2);
    control.publish(known({1, 2}));
    EXPECT_TRUE(control.set_name(2, "Anna").ok());
    EXPECT_EQ(control.set_name(1, "Anna").code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(control.set_name(1, "a\nb").code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(control.set_name(1, std::string(101, 'a')).code(), absl::StatusCode::kInvalidArgument);
    EXPECT_EQ(control.set_name(7, "Ben").code(), absl::StatusCode::kNotFound);
    EXPECT_EQ(control.name_of(2), "Anna");
    EXPECT_EQ(control.list()[1].name, "Anna");
    EXPECT_TRUE(control.set_name(2, "").ok());
    EXPECT_EQ(control.name_of(2), "");
    EXPECT_TRUE(control.set_name(2, "Anna").ok());
    control.publish(known({1}));
    control.publish(known({1, 2}));
    EXPECT_EQ(control.name_of(2), "") << "forgotten with the subject";
}

TEST(SubjectControl, TakesSuggestedNameOnlyOnce) {
    SubjectControl control(2);
    control.suggest_name(1, "Anna");
    EXPECT_EQ(control.name_of(1), "") << "not there yet";
    control.publish(known({1, 2, 3}));
    EXPECT_TRUE(control.set_name(3, "").ok());
    for (const std::uint32_t id : {1, 2, 3}) control.suggest_name(id, "Anna");
    EXPECT_EQ(control.name_of(1), "Anna");
    EXPECT_EQ(control.name_of(2), "Anna") << "two recorded subjects may be one person";
    EXPECT_EQ(control.name_of(3), "") << "without a name on request";
    EXPECT_TRUE(control.set_name(2, "Ben").ok());
    EXPECT_TRUE(control.set_name(1, "").ok());
    for (const std::uint32_t id : {1, 2}) control.suggest_name(id, "Cleo");
    EXPECT_EQ(control.name_of(1), "");
    EXPECT_EQ(control.name_of(2), "Ben");
    control.forget();
    control.publish(known({1}));
    control.suggest_name(1, "Cleo");
    EXPECT_EQ(control.name_of(1), "Cleo");
}

}  // namespace
}  // namespace kinevox
