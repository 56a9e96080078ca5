! Validation: a pose for each of many interpretations at once, one a PE, and a test of every feature (thesis 5.6, 6.7)
ENTRY SUBROUTINE VALIDATE(MODEL, DATUM, KIND, ENDS, ASSIGNED, SIGN, E, N, M, SIZEOF, MAXRADIUS, FRACDEV, CURVEDEV, &
    ROTATION, SHIFT, DEVIATION, PASSED, VALID)
  IMPLICIT NONE
! MODEL, DATUM: of each feature its middle, unit direction, half length and two radii; KIND: 1 of a curve; metres
! ENDS: the two ends of each data feature, of a curve its centre twice
! ASSIGNED(k, i): the model feature of item i in interpretation k, 0 the bin; SIGN: 1, -1, or 0 which is then found
! SIZEOF, MAXRADIUS: of the model; FRACDEV, CURVEDEV: what ends and radii may be off, as parts of these
! ROTATION, SHIFT: camera from model; DEVIATION: of the farther end from its model feature, -1 in the bin
  INTEGER E, N, M, KIND(N), ASSIGNED(,N), SIGN(,N)
  REAL*8 MODEL(9, E), DATUM(9, N), ENDS(3, 2, N), SIZEOF, MAXRADIUS, FRACDEV, CURVEDEV
  REAL*8 ROTATION(*M, 3, 3), SHIFT(*M, 3), DEVIATION(*M, N)
  LOGICAL PASSED(*M, N), VALID(*M)
  REAL*8 CHOSEN(*M, 9, N), WEIGHT(*M), LONGEST(*M), S(*M), LENGTH
  LOGICAL MATCHED(*M, N), SIGNED(*M, N), HERE(*M), NONE(*M), GUESSED
  INTEGER I, J, K, ROUND
! the model feature of each item
  CHOSEN = 0.0D0
  DO 20 I = 1, N
    MATCHED(,I) = ASSIGNED(,I) .GT. 0
    SIGNED(,I) = MATCHED(,I) .AND. SIGN(,I) .NE. 0
    DO 20 K = 1, E
      HERE = ASSIGNED(,I) .EQ. K
      IF (.NOT. ANY(HERE)) GOTO 20
      DO 10 J = 1, 9
        CHOSEN(HERE, J, I) = MODEL(J,K)
10    CONTINUE
20 CONTINUE
! without any sign, that of the longest feature may be chosen
  NONE = .TRUE.
  LONGEST = -1.0D0
  DO 30 I = 1, N
    NONE = NONE .AND. .NOT. SIGNED(,I)
    CALL WEIGH(DATUM(7,I), KIND(I), SIZEOF, LENGTH)
    LONGEST(MATCHED(,I) .AND. LONGEST .LT. LENGTH) = LENGTH
30 CONTINUE
  DO 40 I = 1, N
    CALL WEIGH(DATUM(7,I), KIND(I), SIZEOF, LENGTH)
    HERE = NONE .AND. MATCHED(,I) .AND. LONGEST .EQ. LENGTH
    SIGN(HERE, I) = 1
    SIGNED(HERE, I) = .TRUE.
    NONE = NONE .AND. .NOT. HERE
40 CONTINUE
! the first rotation is that of the signs that are known; the others are read off it
  DO 60 ROUND = 1, 2
    GUESSED = .FALSE.
    CALL ROTATE(CHOSEN, DATUM, KIND, SIGN, SIGNED, N, M, SIZEOF, ROTATION)
    CALL PARALLEL(CHOSEN, DATUM, KIND, SIGN, SIGNED, MATCHED, N, M, SIZEOF, ROTATION)
    DO 50 I = 1, N
      S = 0.0D0
      DO 45 J = 1, 3
        S = S + DATUM(J+3,I)*(ROTATION(,J,1)*CHOSEN(,4,I) + ROTATION(,J,2)*CHOSEN(,5,I) + ROTATION(,J,3)*CHOSEN(,6,I))
45    CONTINUE
      HERE = MATCHED(,I) .AND. .NOT. SIGNED(,I)
      IF (ANY(HERE)) GUESSED = .TRUE.
      SIGN(HERE, I) = MERGE(1, -1, S .GE. 0.0D0)
      SIGNED(,I) = MATCHED(,I)
50  CONTINUE
    IF (.NOT. GUESSED) GOTO 65
60 CONTINUE
65 CONTINUE
  CALL TRANSLATE(CHOSEN, KIND, ENDS, MATCHED, N, M, ROTATION, SHIFT)
  VALID = .TRUE.
  DO 80 I = 1, N
    CALL DEVIATE(CHOSEN(,1,I), CHOSEN(,2,I), CHOSEN(,3,I), CHOSEN(,4,I), CHOSEN(,5,I), CHOSEN(,6,I), CHOSEN(,7,I), &
      ENDS, N, I, M, ROTATION, SHIFT, DEVIATION(,I))
    PASSED(,I) = DEVIATION(,I) .LE. FRACDEV*SIZEOF
    IF (KIND(I) .NE. 1) GOTO 70
    S = MAX(ABS(DATUM(8,I) - CHOSEN(,8,I)), ABS(DATUM(9,I) - CHOSEN(,9,I)))
    PASSED(,I) = PASSED(,I) .AND. S .LE. CURVEDEV*MAXRADIUS
70  CONTINUE
    DEVIATION(.NOT. MATCHED(,I), I) = -1.0D0
    PASSED(.NOT. MATCHED(,I), I) = .TRUE.
    VALID = VALID .AND. PASSED(,I)
80 CONTINUE
END

! How much the direction of a feature counts: that of a longer edge is more certain
SUBROUTINE WEIGH(HALF, KIND, SIZEOF, LENGTH)
  IMPLICIT NONE
  REAL*8 HALF, SIZEOF, LENGTH
  INTEGER KIND
  LENGTH = 2.0D0*HALF
  IF (KIND .EQ. 1) LENGTH = SIZEOF
END

! The rotations that bring model directions nearest to data directions: the quaternion of the largest eigenvalue
SUBROUTINE ROTATE(CHOSEN, DATUM, KIND, SIGN, SIGNED, N, M, SIZEOF, R)
  IMPLICIT NONE
  INTEGER N, M, KIND(N), SIGN(,N), I, J, K
  REAL*8 CHOSEN(,9,N), DATUM(9, N), SIZEOF, R(,3,3), LENGTH
  LOGICAL SIGNED(,N)
  REAL*8 S(*M, 3, 3), W(*M), F(*M, 4, 4), Q(*M, 4)
  S = 0.0D0
  DO 10 I = 1, N
    CALL WEIGH(DATUM(7,I), KIND(I), SIZEOF, LENGTH)
    W = MERGE(LENGTH, 0.0D0, SIGNED(,I))
    W = W*SIGN(,I)
    DO 10 J = 1, 3
      DO 10 K = 1, 3
        S(,J,K) = S(,J,K) + W*CHOSEN(,J+3,I)*DATUM(K+3,I)
10 CONTINUE
  F(,1,1) = S(,1,1) + S(,2,2) + S(,3,3)
  F(,2,2) = S(,1,1) - S(,2,2) - S(,3,3)
  F(,3,3) = S(,2,2) - S(,1,1) - S(,3,3)
  F(,4,4) = S(,3,3) - S(,1,1) - S(,2,2)
  F(,1,2) = S(,2,3) - S(,3,2)
  F(,1,3) = S(,3,1) - S(,1,3)
  F(,1,4) = S(,1,2) - S(,2,1)
  F(,2,3) = S(,1,2) + S(,2,1)
  F(,2,4) = S(,3,1) + S(,1,3)
  F(,3,4) = S(,2,3) + S(,3,2)
  CALL LARGEST(F, M, Q)
  R(,1,1) = 1.0D0 - 2.0D0*(Q(,3)*Q(,3) + Q(,4)*Q(,4))
  R(,1,2) = 2.0D0*(Q(,2)*Q(,3) - Q(,4)*Q(,1))
  R(,1,3) = 2.0D0*(Q(,2)*Q(,4) + Q(,3)*Q(,1))
  R(,2,1) = 2.0D0*(Q(,2)*Q(,3) + Q(,4)*Q(,1))
  R(,2,2) = 1.0D0 - 2.0D0*(Q(,2)*Q(,2) + Q(,4)*Q(,4))
  R(,2,3) = 2.0D0*(Q(,3)*Q(,4) - Q(,2)*Q(,1))
  R(,3,1) = 2.0D0*(Q(,2)*Q(,4) - Q(,3)*Q(,1))
  R(,3,2) = 2.0D0*(Q(,3)*Q(,4) + Q(,2)*Q(,1))
  R(,3,3) = 1.0D0 - 2.0D0*(Q(,2)*Q(,2) + Q(,3)*Q(,3))
END

! Where all directions are parallel: the smallest turn that takes them along, then one about them by the places
SUBROUTINE PARALLEL(CHOSEN, DATUM, KIND, SIGN, SIGNED, MATCHED, N, M, SIZEOF, R)
  IMPLICIT NONE
  INTEGER N, M, KIND(N), SIGN(,N), I, J, K
  REAL*8 CHOSEN(,9,N), DATUM(9, N), SIZEOF, R(,3,3), LENGTH
  LOGICAL SIGNED(,N), MATCHED(,N)
  REAL*8 U(*M, 3), V(*M, 3), FIRST(*M, 3), SPREAD(*M, 3, 3), T(*M, 3, 3), P(*M, 3), Q(*M, 3), W(*M), S(*M), C(*M)
  REAL*8 MIDP(*M, 3), MIDQ(*M, 3), TOTAL(*M), WIDE(*M), PQ(*M), PXQ(*M)
  LOGICAL HERE(*M), ALL1(*M), STARTED(*M)
  U = 0.0D0
  V = 0.0D0
  SPREAD = 0.0D0
  FIRST = 0.0D0
  STARTED = .FALSE.
  TOTAL = 0.0D0
  DO 30 I = 1, N
    CALL WEIGH(DATUM(7,I), KIND(I), SIZEOF, LENGTH)
    W = MERGE(LENGTH, 0.0D0, SIGNED(,I))
    TOTAL = TOTAL + W
    HERE = SIGNED(,I) .AND. .NOT. STARTED
    STARTED = STARTED .OR. HERE
    DO 10 J = 1, 3
      FIRST(HERE, J) = CHOSEN(,J+3,I)
      DO 10 K = 1, 3
        SPREAD(,J,K) = SPREAD(,J,K) + W*DATUM(J+3,I)*DATUM(K+3,I)
10  CONTINUE
    S = FIRST(,1)*CHOSEN(,4,I) + FIRST(,2)*CHOSEN(,5,I) + FIRST(,3)*CHOSEN(,6,I)
    W = MERGE(W, -W, S .GE. 0.0D0)
    DO 20 J = 1, 3
      U(,J) = U(,J) + W*CHOSEN(,J+3,I)
      V(,J) = V(,J) + W*SIGN(,I)*DATUM(J+3,I)
20  CONTINUE
30 CONTINUE
! the squares of the spread add up to one when there is one direction only
  S = 0.0D0
  DO 40 J = 1, 3
    DO 40 K = 1, 3
      S = S + (SPREAD(,J,K)/MAX(TOTAL, 1.0D-12))**2
40 CONTINUE
  ALL1 = STARTED .AND. 1.0D0 - S .LT. 2.0D-9
  IF (.NOT. ANY(ALL1)) RETURN
  CALL UNIT(U, M)
  CALL UNIT(V, M)
  CALL BETWEEN(U, V, M, T)
! about them: the places of the features across their direction
  MIDP = 0.0D0
  MIDQ = 0.0D0
  TOTAL = 0.0D0
  DO 60 I = 1, N
    TOTAL(MATCHED(,I)) = TOTAL + 1.0D0
    DO 50 J = 1, 3
      S = T(,J,1)*CHOSEN(,1,I) + T(,J,2)*CHOSEN(,2,I) + T(,J,3)*CHOSEN(,3,I)
      MIDP(MATCHED(,I), J) = MIDP(,J) + S
      MIDQ(MATCHED(,I), J) = MIDQ(,J) + DATUM(J,I)
50  CONTINUE
60 CONTINUE
  WIDE = 0.0D0
  PQ = 0.0D0
  PXQ = 0.0D0
  DO 100 I = 1, N
    W = 0.0D0
    C = 0.0D0
    DO 70 J = 1, 3
      P(,J) = T(,J,1)*CHOSEN(,1,I) + T(,J,2)*CHOSEN(,2,I) + T(,J,3)*CHOSEN(,3,I) - MIDP(,J)/MAX(TOTAL, 1.0D0)
      Q(,J) = DATUM(J,I) - MIDQ(,J)/MAX(TOTAL, 1.0D0)
      W = W + P(,J)*V(,J)
      C = C + Q(,J)*V(,J)
70  CONTINUE
    DO 80 J = 1, 3
      P(,J) = MERGE(P(,J) - W*V(,J), 0.0D0, MATCHED(,I))
      Q(,J) = MERGE(Q(,J) - C*V(,J), 0.0D0, MATCHED(,I))
      WIDE = MAX(WIDE, MAX(ABS(P(,J)), ABS(Q(,J))))
      PQ = PQ + P(,J)*Q(,J)
80  CONTINUE
    PXQ = PXQ + V(,1)*(P(,2)*Q(,3) - P(,3)*Q(,2)) + V(,2)*(P(,3)*Q(,1) - P(,1)*Q(,3)) &
      + V(,3)*(P(,1)*Q(,2) - P(,2)*Q(,1))
100 CONTINUE
  S = ATAN2(PXQ, PQ)
  S(WIDE .LT. 1.0D-6*SIZEOF) = 0.0D0
  S(TOTAL .LT. 1.5D0) = 0.0D0
  C = COS(S)
  S = SIN(S)
  DO 130 K = 1, 3
    W = V(,1)*T(,1,K) + V(,2)*T(,2,K) + V(,3)*T(,3,K)
    P(,1) = V(,2)*T(,3,K) - V(,3)*T(,2,K)
    P(,2) = V(,3)*T(,1,K) - V(,1)*T(,3,K)
    P(,3) = V(,1)*T(,2,K) - V(,2)*T(,1,K)
    DO 130 J = 1, 3
      Q(,1) = C*T(,J,K) + S*P(,J) + (1.0D0 - C)*W*V(,J)
      R(ALL1, J, K) = Q(,1)
130 CONTINUE
END

! Vectors of unit length
SUBROUTINE UNIT(V, M)
  IMPLICIT NONE
  INTEGER M, J
  REAL*8 V(,3), S(*M)
  S = MAX(SQRT(V(,1)*V(,1) + V(,2)*V(,2) + V(,3)*V(,3)), 1.0D-12)
  DO 10 J = 1, 3
    V(,J) = V(,J)/S
10 CONTINUE
END

! The smallest turns that take U to V; half turns about some direction across where they are opposite
SUBROUTINE BETWEEN(U, V, M, T)
  IMPLICIT NONE
  INTEGER M, J, K
  REAL*8 U(,3), V(,3), T(,3,3), A(*M, 3), C(*M), X(*M), B(*M, 3)
  LOGICAL OPPOSITE(*M), ALONG(*M)
  A(,1) = U(,2)*V(,3) - U(,3)*V(,2)
  A(,2) = U(,3)*V(,1) - U(,1)*V(,3)
  A(,3) = U(,1)*V(,2) - U(,2)*V(,1)
  C = U(,1)*V(,1) + U(,2)*V(,2) + U(,3)*V(,3)
  OPPOSITE = C .LT. -1.0D0 + 1.0D-9
! u x e1, or u x e2 where u lies along e1
  ALONG = ABS(U(,1)) .GT. 0.9D0
  B(,1) = MERGE(-U(,3), 0.0D0, ALONG)
  B(,2) = MERGE(0.0D0, U(,3), ALONG)
  B(,3) = MERGE(U(,1), -U(,2), ALONG)
  CALL UNIT(B, M)
  DO 20 J = 1, 3
    DO 20 K = 1, 3
      X = A(,J)*A(,K)
      IF (J .EQ. K) X = X - (A(,1)*A(,1) + A(,2)*A(,2) + A(,3)*A(,3))
      T(,J,K) = X/MERGE(1.0D0, 1.0D0 + C, OPPOSITE)
      IF (J .EQ. K) T(,J,K) = T(,J,K) + 1.0D0
      X = 2.0D0*B(,J)*B(,K)
      IF (J .EQ. K) X = X - 1.0D0
      T(OPPOSITE, J, K) = X
20 CONTINUE
  A(OPPOSITE, 1) = 0.0D0
  A(OPPOSITE, 2) = 0.0D0
  A(OPPOSITE, 3) = 0.0D0
  T(,1,2) = T(,1,2) - A(,3)
  T(,2,1) = T(,2,1) + A(,3)
  T(,1,3) = T(,1,3) + A(,2)
  T(,3,1) = T(,3,1) - A(,2)
  T(,2,3) = T(,2,3) - A(,1)
  T(,3,2) = T(,3,2) + A(,1)
END

! The eigenvector of the largest eigenvalue of symmetric matrices, given above their diagonals, by Jacobi's rotations
SUBROUTINE LARGEST(F, M, Q)
  IMPLICIT NONE
  INTEGER M, I, J, K, SWEEP
  REAL*8 F(,4,4), Q(,4), V(*M, 4, 4), T(*M), C(*M), S(*M), A(*M), B(*M)
  LOGICAL FLAT(*M), MORE(*M)
  V = 0.0D0
  DO 10 I = 1, 4
    V(,I,I) = 1.0D0
    DO 10 J = I, 4
      F(,J,I) = F(,I,J)
10 CONTINUE
  DO 60 SWEEP = 1, 8
    DO 50 I = 1, 3
      DO 50 J = I + 1, 4
!       the turn that makes the entry I, J zero
        FLAT = ABS(F(,I,J)) .LT. 1.0D-300
        T = (F(,J,J) - F(,I,I))/(2.0D0*MERGE(1.0D0, F(,I,J), FLAT))
        T = SIGN(1.0D0, T)/(ABS(T) + SQRT(T*T + 1.0D0))
        T(FLAT) = 0.0D0
        C = 1.0D0/SQRT(T*T + 1.0D0)
        S = T*C
        DO 20 K = 1, 4
          A = F(,K,I)
          B = F(,K,J)
          F(,K,I) = C*A - S*B
          F(,K,J) = S*A + C*B
          A = V(,K,I)
          B = V(,K,J)
          V(,K,I) = C*A - S*B
          V(,K,J) = S*A + C*B
20      CONTINUE
        DO 30 K = 1, 4
          A = F(,I,K)
          B = F(,J,K)
          F(,I,K) = C*A - S*B
          F(,J,K) = S*A + C*B
30      CONTINUE
50  CONTINUE
!   each sweep squares what is left beside the diagonal
    A = ABS(F(,1,2)) + ABS(F(,1,3)) + ABS(F(,1,4)) + ABS(F(,2,3)) + ABS(F(,2,4)) + ABS(F(,3,4))
    B = ABS(F(,1,1)) + ABS(F(,2,2)) + ABS(F(,3,3)) + ABS(F(,4,4))
    IF (ALL(A .LE. 1.0D-18*B)) GOTO 65
60 CONTINUE
65 A = F(,1,1)
  DO 70 K = 1, 4
    Q(,K) = V(,K,1)
70 CONTINUE
  DO 80 I = 2, 4
    MORE = F(,I,I) .GT. A
    A(MORE) = F(,I,I)
    DO 80 K = 1, 4
      Q(MORE, K) = V(,K,I)
80 CONTINUE
END

! The translations that bring the ends nearest to their model lines, by the normal equations and their inverse
SUBROUTINE TRANSLATE(CHOSEN, KIND, ENDS, MATCHED, N, M, R, SHIFT)
  IMPLICIT NONE
  INTEGER N, M, KIND(N), I, J, K, L, J1, J2, K1, K2
  REAL*8 CHOSEN(,9,N), ENDS(3, 2, N), R(,3,3), SHIFT(,3)
  LOGICAL MATCHED(,N)
  REAL*8 A(*M, 3, 3), B(*M, 3), U(*M, 3), G(*M, 3), P(*M), DET(*M)
  A = 0.0D0
  B = 0.0D0
  DO 40 I = 1, N
    DO 10 J = 1, 3
      U(,J) = R(,J,1)*CHOSEN(,4,I) + R(,J,2)*CHOSEN(,5,I) + R(,J,3)*CHOSEN(,6,I)
      IF (KIND(I) .EQ. 1) U(,J) = 0.0D0
10  CONTINUE
    DO 30 L = 1, 2
      DO 20 J = 1, 3
        G(,J) = ENDS(J,L,I) - (R(,J,1)*CHOSEN(,1,I) + R(,J,2)*CHOSEN(,2,I) + R(,J,3)*CHOSEN(,3,I))
20    CONTINUE
      DO 30 J = 1, 3
        DO 30 K = 1, 3
!         across the line, or all of it for a point
          P = -U(,J)*U(,K)
          IF (J .EQ. K) P = P + 1.0D0
          A(MATCHED(,I), J, K) = A(,J,K) + P
          B(MATCHED(,I), J) = B(,J) + P*G(,K)
30  CONTINUE
40 CONTINUE
! the inverse by cofactors
  DET = 0.0D0
  SHIFT = 0.0D0
  DO 60 J = 1, 3
    J1 = MOD(J, 3) + 1
    J2 = MOD(J + 1, 3) + 1
    DO 50 K = 1, 3
      K1 = MOD(K, 3) + 1
      K2 = MOD(K + 1, 3) + 1
      P = A(,J1,K1)*A(,J2,K2) - A(,J1,K2)*A(,J2,K1)
      SHIFT(,J) = SHIFT(,J) + P*B(,K)
      IF (J .EQ. 1) DET = DET + P*A(,1,K)
50  CONTINUE
60 CONTINUE
  DO 70 J = 1, 3
    SHIFT(,J) = SHIFT(,J)/DET
70 CONTINUE
END

! How far the farther end of item I is from its model feature, in the model's frame
SUBROUTINE DEVIATE(X, Y, Z, DX, DY, DZ, HALF, ENDS, N, I, M, R, SHIFT, FAR)
  IMPLICIT NONE
  INTEGER N, I, M, J, L
  REAL*8 X(), Y(), Z(), DX(), DY(), DZ(), HALF(), ENDS(3, 2, N), R(,3,3), SHIFT(,3), FAR()
  REAL*8 G(*M, 3), ALONG(*M)
  FAR = 0.0D0
  DO 20 L = 1, 2
    DO 10 J = 1, 3
      G(,J) = R(,1,J)*(ENDS(1,L,I) - SHIFT(,1)) + R(,2,J)*(ENDS(2,L,I) - SHIFT(,2)) + R(,3,J)*(ENDS(3,L,I) - SHIFT(,3))
10  CONTINUE
    G(,1) = G(,1) - X
    G(,2) = G(,2) - Y
    G(,3) = G(,3) - Z
    ALONG = MAX(MIN(G(,1)*DX + G(,2)*DY + G(,3)*DZ, HALF), -HALF)
    G(,1) = G(,1) - ALONG*DX
    G(,2) = G(,2) - ALONG*DY
    G(,3) = G(,3) - ALONG*DZ
    FAR = MAX(FAR, SQRT(G(,1)*G(,1) + G(,2)*G(,2) + G(,3)*G(,3)))
20 CONTINUE
END
