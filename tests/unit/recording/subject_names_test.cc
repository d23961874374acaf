// Names of subjects: their file, file names made of them, and whom they belong to in a repeated run.
#include "server/recording/subject_names.h"

#include <gmock/gmock.h>

#include <set>
#include <vector>

#include "server/recording/trial.h"
#include "tests/support/posed_trial.h"
#include "tests/support/temporary_folder.h"

namespace kinevox {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Pair;

TEST(SubjectNames, ReadsWhatItWrites) {
    const SubjectNames names{{1, "Anna"}, {2, "Müller, \"Jo\""}, {7, "李 雷"}, {8, "Anna"}, {9, " \""}};
    const testing::TemporaryFolder folder;
    folder.write("subjects.csv", subject_names_csv(names));
    const auto read = read_subject_names(folder.path());
    ASSERT_TRUE(read.ok()) << read.status();
    EXPECT_EQ(*read, names);
    EXPECT_THAT(subject_names_csv(names), HasSubstr("2,\"Müller, \"\"Jo\"\"\"\n"));
}

TEST(SubjectNames, IsEmptyWithoutFile) {
    const testing::TemporaryFolder folder;
    EXPECT_THAT(*read_subject_names(folder.path()), IsEmpty());
}

TEST(SubjectNames, RefusesDamagedFiles) {
    const testing::TemporaryFolder folder;
    for (const auto& [text, expected] : std::vector<std::pair<std::string, std::string>>{
             {"subject;name\n", "subjects.csv:1: is 'subject;name', expected the header 'subject,name'"},
             {"subject,name\n0,Anna\n", "subjects.csv:2: is '0,Anna'"},
             {"subject,name\n1,Anna\nx,Ben\n", "subjects.csv:3: is 'x,Ben'"},
             {"subject,name\n1\n", "subjects.csv:2: is '1'"},
             {"subject,name\n1,\"Anna\n", "subjects.csv:2: is '1,\"Anna'"},
             {"subject,name\n1,\"An\"na\"\n", "subjects.csv:2"},
             {"subject,name\n-1,Anna\n", "subjects.csv:2"}}) {
        folder.write("subjects.csv", text);
        const auto read = read_subject_names(folder.path());
        EXPECT_TRUE(absl::IsInvalidArgument(read.status())) << text;
        EXPECT_THAT(std::string(read.status().message()), HasSubstr(expected));
    }
}

TEST(SubjectNames, FileNamesArePlainAndDistinct) {
    EXPECT_EQ(subject_file_name(3, ""), "s3");
    EXPECT_EQ(subject_file_name(3, "Anna B."), "s3_Anna_B_");
    EXPECT_EQ(subject_file_name(3, "../a\\b:*?\"<>|"), "s3____a_b_______");
    EXPECT_EQ(subject_file_name(3, "Jörg"), "s3_Jörg");
    std::set<std::string> distinct;
    for (const std::uint32_t id : {1, 2, 11})
        for (const char* name : {"", "a/b", "a_b", "1"}) distinct.insert(subject_file_name(id, name));
    EXPECT_EQ(distinct.size(), 9U) << "a/b and a_b are equal, but for the id";
}

TEST(SubjectNames, CommonNameIsThatOfAll) {
    const SubjectNames names{{1, "Anna"}, {2, "Anna"}, {3, "Ben"}};
    EXPECT_EQ(common_subject_name(names, {1, 2}), "Anna");
    EXPECT_EQ(common_subject_name(names, {1, 3}), "");
    EXPECT_EQ(common_subject_name(names, {1, 4}), "");
    EXPECT_EQ(common_subject_name(names, {}), "");
}

TEST(SubjectNames, TrialsHaveThem) {
    const testing::TemporaryFolder folder;
    ASSERT_TRUE(testing::write_posed_people(folder.path(), 4, {{1, "Anna"}, {4, "Anna"}}).ok());
    const auto trials = read_trials(folder.path(), 0, *subjects_of_trial(folder.path()));
    ASSERT_TRUE(trials.ok()) << trials.status();
    std::vector<std::string> names;
    for (const Trial& trial : *trials) names.push_back(trial.subject_name);
    EXPECT_THAT(names, ElementsAre("Anna", "", "", "Anna"));

    ASSERT_TRUE(testing::write_posed_people(folder.path(), 1, {{1, "Ben"}}).ok());
    EXPECT_EQ(read_trial(folder.path())->subject_name, "Ben");
    folder.write("subjects.csv", "subject,name\nBen\n");
    EXPECT_THAT(std::string(read_trial(folder.path()).status().message()), HasSubstr("subjects.csv:2"));
}

class RecordedNamesTest : public ::testing::Test {
  protected:
    void record(int count, const SubjectNames& names) {
        ASSERT_TRUE(testing::write_posed_people(folder_.path(), count, names).ok());
        auto read = RecordedNames::read(folder_.path());
        ASSERT_TRUE(read.ok()) << read.status();
        names_ = *std::move(read);
    }
    static Vec3 person(int number, int frame) {  // from 1
        const BodyCoordinates q = testing::posed_coordinates(frame);
        return {q[0], q[1] + 1.5 * (number - 1), q[2] + 0.1};
    }
    RecordedNames names_;
    testing::TemporaryFolder folder_;
};

TEST_F(RecordedNamesTest, FollowPositionsNotIds) {
    record(4, {{1, "Anna"}, {2, "Ben"}, {4, "Anna"}});
    for (int frame = 0; frame < 20; ++frame)
        for (int number = 1; number <= 4; ++number)
            names_.add(frame, static_cast<std::uint32_t>(14 - number), person(number, frame));
    EXPECT_THAT(names_.names(), ElementsAre(Pair(10, "Anna"), Pair(12, "Ben"), Pair(13, "Anna")));
    EXPECT_EQ(names_.name_of(11), "") << "the recorded one had none";
    EXPECT_EQ(names_.name_of(99), "");
}

TEST_F(RecordedNamesTest, MostFramesDecide) {
    record(2, {{1, "Anna"}, {2, "Ben"}});
    names_.add(0, 1, person(2, 0));
    EXPECT_EQ(names_.name_of(1), "Ben");
    EXPECT_EQ(names_.name_of(1, 2), "") << "in one frame only";
    for (int frame = 1; frame < 4; ++frame) names_.add(frame, 1, person(1, frame));
    EXPECT_EQ(names_.name_of(1, 3), "Anna");
    names_.forget();
    EXPECT_EQ(names_.name_of(1), "");
}

TEST_F(RecordedNamesTest, IgnoresWhoIsFarAway) {
    record(1, {{1, "Anna"}});
    const Vec3 at = person(1, 5);
    names_.add(5, 1, {at.x + 0.8, at.y, at.z});
    names_.add(1000, 2, at);
    EXPECT_THAT(names_.names(), IsEmpty());
}

TEST_F(RecordedNamesTest, NeedNoTablesWithoutNames) {
    const auto none = RecordedNames::read(folder_.path());
    ASSERT_TRUE(none.ok()) << none.status();
    EXPECT_TRUE(none->empty());
}

}  // namespace
}  // namespace kinevox
