#include "commands/keys/permit_command.hpp"

#include <nlohmann/json.hpp>
#include <ostream>

#include "base/error.hpp"
#include "base/files.hpp"
#include "commands/keys/root_signing.hpp"

namespace nadir {

void PermitCommand::setup(Options& options) {
  options.values("--key", keys_, "KEY.pem", "private key (file or pkcs11: URI) of a package signer; may be repeated")
      .required();
  setup_step(options);
  options.value("--airframe", airframe_, "ID", "for this airframe only");
  options.value("--expires", expires_, "DATE", "end of validity").required();
  options.value("--out", out_, "PERMIT.json", "permit file to create").required();
}

int PermitCommand::run(Context& context) {
  if (std::filesystem::exists(std::filesystem::symlink_status(out_))) {
    throw UsageError({.what = "the output already exists", .where = out_, .fix = "choose another --out"});
  }
  check_expires(expires_, context.clock);
  check_step();
  const std::vector<PrivateKey> keys = read_private_keys(keys_);
  const SignedDocument permit = sign(pointers_to(keys));
  write_new_file(out_, permit.json());
  if (context.json) {
    nlohmann::json result = nlohmann::json::parse(permit.signed_bytes);
    result.erase("schema");
    result["permit"] = out_.string();
    result["signatures"] = permit.signatures.size();
    print_json(context.out, result);
    return kAccepted;
  }
  Figures figures{{"permit", out_.string()}};
  for (auto& figure : step_figures()) figures.push_back(std::move(figure));
  figures.insert(figures.end(), {{"airframe", airframe_.value_or("any")},
                                 {"expires", to_rfc3339(expires_)},
                                 {"signatures", std::to_string(permit.signatures.size())}});
  print_figures(context.out, figures);
  return kAccepted;
}

}  // namespace nadir
