// The candidate service's answers as documents of schemas/candidates.openapi.yaml.
#pragma once

#include "candidates/service_result.hpp"
#include "http/problem.hpp"

namespace nadir {

ApiResponse announcement_answer(const Announcement& announcement, std::uint64_t part_max);
ApiResponse completion_answer(const Completion& completion);
ApiResponse status_answer(const UploadStatus& status);
ApiResponse reason_codes_answer();
ApiResponse health_answer(const std::string& trouble, bool fails);
ApiResponse denial_answer(const Denial& denial);
ApiResponse later(int status, std::string type, std::string detail);  // with Retry-After

}  // namespace nadir
