#include "trust/signed_document.hpp"

#include <gtest/gtest.h>

#include "base/bytes.hpp"
#include "base/error.hpp"

namespace nadir {
namespace {

// The protocol's own example.
TEST(Dsse, MatchesTheExampleOfTheProtocol) {
  EXPECT_EQ(as_text(pre_authentication_encoding("http://example.com/HelloWorld", as_bytes("hello world"))),
            "DSSEv1 29 http://example.com/HelloWorld 11 hello world");
}

TEST(Dsse, RoundTrips) {
  const PrivateKey key = PrivateKey::generate();
  const Envelope envelope{"type", {sign_payload(key, "type", as_bytes("body"))}};
  const Envelope back = parse_envelope(envelope_json(envelope), "test");
  EXPECT_EQ(back.payload_type, "type");
  ASSERT_EQ(back.signatures.size(), 1U);
  EXPECT_EQ(back.signatures[0].keyid, key.public_key().id());
  EXPECT_TRUE(key.public_key().verifies(as_bytes("DSSEv1 4 type 4 body"), back.signatures[0].signature));
}

TEST(Dsse, RejectsInvalidEnvelopes) {
  const std::string id(64, 'a'), sig = to_base64(Bytes(64));
  const std::string good = R"({"keyid":")" + id + R"(","sig":")" + sig + R"("})";
  EXPECT_NO_THROW(parse_envelope(R"({"payloadType":"t","signatures":[)" + good + "]}", "test"));
  const std::string bad[] = {
      "",
      "null",
      "[]",
      "{}",
      R"({"payloadType":"t","signatures":[]})",
      R"({"payloadType":"t","signatures":{}})",
      R"({"payloadType":1,"signatures":[)" + good + "]}",
      R"({"payloadType":"t","signatures":[)" + good + R"(],"payload":""})",
      R"({"payloadType":"t","payloadType":"t","signatures":[)" + good + "]}",
      R"({"payloadType":"t","signatures":[)" + good + "," + good + "]}",  // one key, counted twice
      R"({"payloadType":"t","signatures":[{"keyid":")" + id + R"("}]})",
      R"({"payloadType":"t","signatures":[{"keyid":"a","sig":")" + sig + R"("}]})",
      R"({"payloadType":"t","signatures":[{"keyid":")" + id + R"(","sig":"AAAA"}]})",
      R"({"payloadType":"t","signatures":[{"keyid":")" + id + R"(","sig":")" + sig + R"(","alg":"none"}]})",
      R"({"payloadType":"t","signatures":[[[[[[1]]]]]]})",
      R"({"payloadType":"t","signatures":[)" + good + "]} x",
      R"({"payloadType":"t","signatures":[)" + good + "]",
  };
  for (const std::string& text : bad) EXPECT_THROW(parse_envelope(text, "test"), Error) << text;
}

TEST(Dsse, LimitsTheNumberOfSignatures) {
  std::string list;
  for (int i = 0; i < 33; ++i) {
    char id[65];
    std::snprintf(id, sizeof id, "%064x", static_cast<unsigned>(i));
    list += std::string(i == 0 ? "" : ",") + R"({"keyid":")" + id + R"(","sig":")" + to_base64(Bytes(64)) + R"("})";
  }
  EXPECT_THROW(parse_envelope(R"({"payloadType":"t","signatures":[)" + list + "]}", "test"), Error);
}

}  // namespace

}  // namespace nadir
