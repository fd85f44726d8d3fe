/* Takes DOMAIN SECONDS and topics with a letter before each: w writes, r reads. */
#include <dds/dds.h>
#include <stdio.h>
#include <stdlib.h>
#include "Float64.h"

int main(int n, char **a) {
  dds_entity_t p = dds_create_participant(atoi(a[1]), NULL, NULL), ends[9];
  int heard[9] = {0};
  for (int i = 3; i < n; i++) {
    dds_entity_t t = dds_create_topic(p, &std_msgs_msg_dds__Float64__desc, a[i] + 1, NULL, NULL);
    ends[i] = t < 0 ? t : a[i][0] == 'w' ? dds_create_writer(p, t, NULL, NULL)
                                         : dds_create_reader(p, t, NULL, NULL);
  }
  for (int round = 0; round < atoi(a[2]) * 20; round++, dds_sleepfor(DDS_MSECS(50)))
    for (int i = 3; i < n; i++) {
      std_msgs_msg_dds__Float64_ message = {round};
      void *taken[1] = {NULL};
      dds_sample_info_t info[1];
      if (ends[i] < 0) continue;
      if (a[i][0] == 'w') dds_write(ends[i], &message);
      else if (dds_take(ends[i], taken, info, 1, 1) == 1) {
        heard[i] += info[0].valid_data;
        dds_return_loan(ends[i], taken, 1);
      }
    }
  for (int i = 3; i < n; i++)
    printf("%s %s\n", a[i], ends[i] == DDS_RETCODE_NOT_ALLOWED_BY_SECURITY ? "refused"
                            : ends[i] < 0 ? "failed" : a[i][0] == 'w' ? "allowed"
                            : heard[i] ? "heard" : "silent");
  return 0;
}
