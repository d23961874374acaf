#include "common/toml_characters.h"

namespace kinevox {
namespace {

bool beyond_ascii(char c) {
    return static_cast<unsigned char>(c) >= 0x80;
}

// Walks a text once, knowing whether it is within a string.
class Walker {
  public:
    explicit Walker(std::string_view toml) : text_(toml) {
        if (text_.starts_with("\xef\xbb\xbf")) at_ = 3;
    }

    int line_of_misplaced_character() {
        while (at_ < text_.size()) {
            const char c = text_[at_];
            if (beyond_ascii(c)) return line_;
            if (c == '#') {
                while (at_ < text_.size() && text_[at_] != '\n') ++at_;
            } else if (c == '"' || c == '\'') {
                // A quote within a word opens nothing, and which of the later quotes and '#' do is the parser's
                // to say: from here on only ASCII is certain to be safe.
                if (!string_may_begin_) return line_of_next_beyond_ascii();
                if (!skip_string(c)) return line_;
                string_may_begin_ = false;
            } else {
                note_punctuation(c);
                step();
            }
        }
        return 0;
    }

  private:
    // Where the next string may begin, and whether a key is being read: `a."b c"` is a key of two parts,
    // while `3."` is a broken number.
    void note_punctuation(char c) {
        if (c == ' ' || c == '\t') return;
        if (c == '=') in_key_ = false;
        if (!in_key_ && (c == '[' || c == '{')) ++open_brackets_;
        if (!in_key_ && (c == ']' || c == '}')) --open_brackets_;
        if (c == '\n' && open_brackets_ == 0) in_key_ = true;
        string_may_begin_ = std::string_view("=[,{\r\n").find(c) != std::string_view::npos || (c == '.' && in_key_);
    }

    int line_of_next_beyond_ascii() {
        for (; at_ < text_.size(); step())
            if (beyond_ascii(text_[at_])) return line_;
        return 0;
    }

    void step() { line_ += text_[at_++] == '\n'; }

    bool triple(char quote) const {
        return at_ + 2 < text_.size() && text_[at_] == quote && text_[at_ + 1] == quote &&
               text_[at_ + 2] == quote;
    }

    // From a string's opening quotes to behind its closing ones. False at a misplaced character.
    bool skip_string(char quote) {
        const bool multi_line = triple(quote);
        at_ += multi_line ? 3 : 1;
        while (at_ < text_.size()) {
            const char c = text_[at_];
            if (c == '\\' && quote == '"') {
                step();
                if (!skip_escaped()) return false;
            } else if (multi_line && triple(quote)) {
                at_ += 3;
                // The string may end in one or two quotes of its own.
                for (int own = 0; own < 2 && at_ < text_.size() && text_[at_] == quote; ++own) ++at_;
                return true;
            } else if (!multi_line && (c == quote || c == '\n')) {
                step();  // a line's end within a string is an error that the parser tells
                return true;
            } else {
                step();
            }
        }
        return true;
    }

    // Behind a backslash: the escaped character, or the blanks that a line's end swallows.
    bool skip_escaped() {
        const auto blank = [](char c) { return c == ' ' || (c >= '\t' && c <= '\r'); };
        if (at_ < text_.size() && !blank(text_[at_]) && !beyond_ascii(text_[at_])) {
            step();
            return true;
        }
        while (at_ < text_.size() && blank(text_[at_])) step();
        return at_ == text_.size() || !beyond_ascii(text_[at_]);
    }

    std::string_view text_;
    std::size_t at_ = 0;
    int line_ = 1;
    bool string_may_begin_ = true;  // here, after what came before on the line
    bool in_key_ = true;
    int open_brackets_ = 0;  // of arrays and inline tables, all of a value
};

}  // namespace

int line_of_misplaced_character(std::string_view toml) {
    return Walker(toml).line_of_misplaced_character();
}

}  // namespace kinevox
