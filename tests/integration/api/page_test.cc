#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "server/api/request_arguments.h"

namespace kinevox {
namespace {

using ::testing::HasSubstr;

TEST(Page, HoldsAllElementsByDefault) {
    const auto page = page_of(5, 0, "");
    ASSERT_TRUE(page.ok());
    EXPECT_EQ(page->first, 0u);
    EXPECT_EQ(page->last, 5u);
    EXPECT_TRUE(page->next_token.empty());
}

TEST(Page, ContinuesFromToken) {
    auto page = page_of(5, 2, "");
    EXPECT_EQ(page->last, 2u);
    page = page_of(5, 2, page->next_token);
    EXPECT_EQ(page->first, 2u);
    page = page_of(5, 2, page->next_token);
    EXPECT_EQ(page->first, 4u);
    EXPECT_EQ(page->last, 5u);
    EXPECT_TRUE(page->next_token.empty());
}

TEST(Page, IsEmptyIfListBecameShorter) {
    const auto page = page_of(1, 2, "4");
    ASSERT_TRUE(page.ok());
    EXPECT_EQ(page->first, page->last);
    EXPECT_TRUE(page->next_token.empty());
}

TEST(Page, RejectsInvalidSizesAndTokens) {
    EXPECT_EQ(page_of(5, -1, "").status().code(), absl::StatusCode::kInvalidArgument);
    for (const char* token : {"x", "-1", "1x", " 1", "99999999999999999999999"})
        EXPECT_EQ(page_of(5, 1, token).status().code(), absl::StatusCode::kInvalidArgument) << token;
}

TEST(SubjectChoice, DefaultsToTheOnlySubject) {
    EXPECT_EQ(*choose_subject(0, {}), 0u);
    EXPECT_EQ(*choose_subject(0, {3}), 3u);
    EXPECT_EQ(*choose_subject(3, {3, 4}), 3u);
}

TEST(SubjectChoice, NamesSubjectsIfThereAreSeveral) {
    const absl::Status several = choose_subject(0, {3, 4}).status();
    EXPECT_EQ(several.code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(several.message()), HasSubstr("3, 4"));
    EXPECT_EQ(choose_subject(7, {3, 4}).status().code(), absl::StatusCode::kNotFound);
}

}  // namespace
}  // namespace kinevox
