#include "server/api/control_lease.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace kinevox {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

class ControlLeaseTest : public ::testing::Test {
  protected:
    ControlLease::Clock::time_point now_ = ControlLease::Clock::now();
    ControlLease lease_{{30s, 60s}, [this] { return now_; }};
};

TEST_F(ControlLeaseTest, HasOneHolderAtATime) {
    const auto ann = lease_.acquire("ann", 10s);
    ASSERT_TRUE(ann.ok());
    now_ += 3s;
    const auto bob = lease_.acquire("bob", 10s);
    EXPECT_EQ(bob.status().code(), absl::StatusCode::kFailedPrecondition);
    EXPECT_THAT(std::string(bob.status().message()), HasSubstr("'ann' for another 7.0 s"));
    EXPECT_FALSE(lease_.acquire("ann", 10s).ok()) << "the name alone grants nothing";
    EXPECT_FALSE(lease_.use("").ok());
    EXPECT_FALSE(lease_.use("0123456789abcdef").ok());
    EXPECT_TRUE(lease_.use(ann->lease_id).ok());
}

TEST_F(ControlLeaseTest, IsRenewedByUseAndExpires) {
    const auto ann = lease_.acquire("ann", 10s);
    now_ += 9s;
    EXPECT_TRUE(lease_.use(ann->lease_id).ok());
    now_ += 9s;
    EXPECT_EQ(lease_.holder()->remaining, 1s);
    EXPECT_FALSE(lease_.take_expired());
    now_ += 1s;
    EXPECT_FALSE(lease_.holder());
    EXPECT_THAT(std::string(lease_.use(ann->lease_id).status().message()), HasSubstr("expired"));
    EXPECT_EQ(lease_.take_expired(), "ann");
    EXPECT_FALSE(lease_.take_expired()) << "reported once";
    EXPECT_TRUE(lease_.acquire("bob", 0s).ok());
}

TEST_F(ControlLeaseTest, HolderRenewsWithAnotherTimeout) {
    const auto ann = lease_.acquire("ann", 10s);
    const auto again = lease_.acquire("ann", 50s, ann->lease_id);
    ASSERT_TRUE(again.ok());
    EXPECT_EQ(again->lease_id, ann->lease_id);
    EXPECT_EQ(lease_.holder()->remaining, 50s);
}

TEST_F(ControlLeaseTest, IsReleasedByItsHolderOnly) {
    const auto ann = lease_.acquire("ann", 0s);
    EXPECT_EQ(lease_.holder()->remaining, 30s) << "the default";
    EXPECT_FALSE(lease_.release("another lease").ok());
    EXPECT_EQ(*lease_.release(ann->lease_id), "ann");
    EXPECT_FALSE(lease_.holder());
    EXPECT_FALSE(lease_.use(ann->lease_id).ok());
}

TEST_F(ControlLeaseTest, RejectsInvalidNamesAndTimeouts) {
    for (const std::string& name : {std::string(), std::string(101, 'x'), std::string("a\nb")})
        EXPECT_EQ(lease_.acquire(name, 10s).status().code(), absl::StatusCode::kInvalidArgument) << name;
    for (const auto timeout : {-1ms, 60'001ms})
        EXPECT_EQ(lease_.acquire("ann", timeout).status().code(), absl::StatusCode::kInvalidArgument);
    EXPECT_FALSE(lease_.holder());
}

TEST_F(ControlLeaseTest, IdsAreUnique) {
    const auto first = lease_.acquire("ann", 0s);
    ASSERT_TRUE(lease_.release(first->lease_id).ok());
    EXPECT_NE(lease_.acquire("ann", 0s)->lease_id, first->lease_id);
}

}  // namespace
}  // namespace kinevox
