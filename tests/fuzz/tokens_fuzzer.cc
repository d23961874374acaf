#include <cstdint>
#include <string>

#include "server/access/token_file.h"
#include "tests/fuzz/fuzz_check.h"

// tokens.toml, which reads back as written.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
    using namespace kinevox;
    const std::string text(data, data + size);
    const auto tokens = parse_tokens(text, "fuzz.toml");
    FUZZ_CHECK(tokens.ok() || tokens.status().message().find('\n') == absl::string_view::npos);
    if (tokens.ok()) {
        for (const Token& token : *tokens) {
            FUZZ_CHECK(!token.name.empty() && token.name.size() <= 64 && token.role != v1::ROLE_UNSPECIFIED);
            (void)token.valid(1'700'000'000);
        }
        const auto again = parse_tokens(to_toml(*tokens), "again.toml");
        FUZZ_CHECK(again.ok() && *again == *tokens);
    }
    return 0;
}
